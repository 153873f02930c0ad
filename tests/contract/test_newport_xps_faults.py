"""The driver of the Newport XPS: faults, stopping, the safe state."""

import asyncio

import pytest

from drivers.dialects.newport_xps.axis import NewportXps
from drivers.errors import InstrumentFault, Refused
from tests.support.head import XPS, Head, now_s, with_driver

# Faults


def test_an_error_is_told_in_the_controllers_words_and_never_cleared() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        await driver.move_to(10, approach="direct", settle_s=0)
        head.controller.trip()
        words = r"HEAD\.Pos has an error: Fatal following error; received 0x2.*PositionerErrorGet"
        with pytest.raises(InstrumentFault, match=words):
            await driver.poll()
        with pytest.raises(InstrumentFault, match=words):
            await driver.move_to(20, approach="direct", settle_s=0)
        assert head.moves() == ["10.0"]
        assert head.wire.count(b"PositionerErrorGet") == head.wire.count(b"GroupMotionEnable") == 0
        head.call("PositionerErrorGet(HEAD.Pos,int *)")
        with pytest.raises(InstrumentFault, match=r"was disabled by a fault: Disabled state due to a following error"):
            await driver.move_to(20, approach="direct", settle_s=0)
        head.call("GroupMotionEnable(HEAD)")
        await driver.move_to(20, approach="direct", settle_s=0)

    with_driver(use, XPS)


def test_a_fault_during_a_move_ends_it() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        asyncio.get_running_loop().call_later(1.0, head.controller.trip)
        with pytest.raises(InstrumentFault, match=r"Fatal following error; sent GroupMoveAbsolute\(HEAD\.Pos,40\.0\)"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() < 1.3

    with_driver(use, XPS)


def test_a_move_that_somebody_else_aborts_is_refused() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        asyncio.get_running_loop().call_later(1.0, head.call, "GroupMoveAbort(HEAD)")
        with pytest.raises(Refused, match="did not execute a call: Error -27 : Move Aborted"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() < 1.3

    with_driver(use, XPS)


# Stopping and the safe state


def test_making_safe_is_idempotent_and_legal_in_any_state() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        await driver.make_safe()
        head.controller.trip()
        await driver.make_safe()
        head.call("GroupKill(HEAD)")
        await driver.make_safe()
        await driver.stop()
        assert head.moves() == []
        assert head.controller.status == 7

    with_driver(use, XPS)


def test_making_safe_does_not_rest_on_a_connection_that_is_gone_unnoticed() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        stopping = head.wire.connections[2]
        head.wire.lose = lambda request: b"Abort" in request and head.wire.requests[-2:].count(request) == 1
        await driver.make_safe()
        assert stopping is head.wire.connections[-1]
        assert not head.moving

    with_driver(use, XPS)


def test_a_lost_connection_for_stopping_is_opened_again() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.wire.drop()
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        await asyncio.sleep(0.1)
        await driver.stop()
        assert not head.moving

    with_driver(use, XPS)


def test_a_lost_connection_for_moves_is_opened_again_before_a_move() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        moving = head.wire.connections[1].transport
        assert moving is not None
        moving.abort()
        await asyncio.sleep(0.1)
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert len(head.wire.connections) == 4

    with_driver(use, XPS)
