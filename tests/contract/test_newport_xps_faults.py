"""The driver of the Newport XPS: faults, stopping, the safe state."""

import asyncio

import pytest

from drivers.errors import CannotConnect, InstrumentFault, NoAnswer, Refused
from drivers.newport_xps.driver import NewportXps
from tests.support.xps import XpsHead, now_s, with_xps, with_xps_driver

# Faults


def test_an_error_is_told_in_the_controllers_words_and_never_cleared() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
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

    with_xps_driver(use)


def test_a_fault_during_a_move_ends_it() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        asyncio.get_running_loop().call_later(1.0, head.controller.trip)
        with pytest.raises(InstrumentFault, match=r"Fatal following error; sent GroupMoveAbsolute\(HEAD\.Pos,40\.0\)"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() < 1.3

    with_xps_driver(use)


def test_a_move_that_somebody_else_aborts_is_refused() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        asyncio.get_running_loop().call_later(1.0, head.call, "GroupMoveAbort(HEAD)")
        with pytest.raises(Refused, match="did not carry out a call: Error -27 : Move Aborted"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() < 1.3

    with_xps_driver(use)


def test_somebody_else_moving_the_axis_is_a_fault_within_one_poll() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        await driver.move_to(10, approach="direct", settle_s=0)
        head.call("GroupMoveAbsolute(HEAD.Pos,12.0)")
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"stands at 12\.00000°, it was sent to 10\.00000°"):
            await driver.poll()

    with_xps_driver(use)


# Stopping and the safe state


@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_stopping_ends_the_move_under_way(ending: str) -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        move = asyncio.create_task(driver.move_to(100, approach="from_above", settle_s=0))
        await asyncio.sleep(2.05)
        assert (await driver.poll())["angle"][0].value == pytest.approx(head.angle_deg, abs=0.1)  # not held up
        await getattr(driver, ending)()
        assert not head.moving
        stood_deg = head.angle_deg
        with pytest.raises(Refused, match=r"Move Aborted|ended by another command"):
            await move
        await asyncio.sleep(10)
        assert head.angle_deg == stood_deg
        assert head.moves() == ["102.0"]
        await driver.move_to(0, approach="direct", settle_s=0)

    with_xps_driver(use)


def test_making_safe_is_idempotent_and_legal_in_any_state() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        await driver.make_safe()
        head.controller.trip()
        await driver.make_safe()
        head.call("GroupKill(HEAD)")
        await driver.make_safe()
        await driver.stop()
        assert head.moves() == []
        assert head.controller.status == 7

    with_xps_driver(use)


def test_making_safe_stops_while_a_question_has_no_answer() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        head.wire.mute(b"PositionCurrent")
        reading = asyncio.create_task(driver.angle())
        await asyncio.sleep(0.5)
        before_deg, start_s = head.angle_deg, now_s()
        await driver.make_safe()
        assert now_s() - start_s < 5
        assert head.angle_deg - before_deg < 0.1
        with pytest.raises(Refused, match="cut short"):
            await reading

    with_xps_driver(use)


def test_making_safe_does_not_rest_on_a_connection_that_is_gone_unnoticed() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        stopping = head.wire.connections[2]
        head.wire.lose = lambda request: b"Abort" in request and head.wire.requests[-2:].count(request) == 1
        await driver.make_safe()
        assert stopping is head.wire.connections[-1]
        assert not head.moving

    with_xps_driver(use)


def test_a_lost_connection_for_stopping_is_opened_again() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.wire.drop()
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        await asyncio.sleep(0.1)
        await driver.stop()
        assert not head.moving

    with_xps_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        for tap in head.wire.connections:
            assert tap.transport is not None
            tap.transport.abort()
        await asyncio.sleep(1)
        assert head.moving
        await driver.make_safe()
        assert not head.moving
        assert len(head.wire.connections) == 5
        await driver.move_to(10, approach="direct", settle_s=0)

    with_xps_driver(use)


def test_making_safe_before_it_was_ever_connected() -> None:
    async def use(head: XpsHead) -> None:
        driver = head.driver()
        head.call("GroupMoveAbsolute(HEAD.Pos,300.0)")
        await driver.make_safe()
        assert not head.moving
        await driver.__aexit__()

    with_xps(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        head.wire.drop()
        head.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_xps_driver(use)


def test_a_lost_connection_for_moves_is_opened_again_before_a_move() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        moving = head.wire.connections[1].transport
        assert moving is not None
        moving.abort()
        await asyncio.sleep(0.1)
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert len(head.wire.connections) == 4

    with_xps_driver(use)


@pytest.mark.parametrize("tens", range(4))
def test_silence_is_reported_within_a_deadline_whenever_it_begins(tens: int) -> None:
    async def work(driver: NewportXps) -> None:
        async with driver:
            await driver.move_to(40, approach="from_above", settle_s=1)
            for _ in range(20):
                await driver.poll()
                await asyncio.sleep(1)

    for silent_from in range(10 * tens + 1, 10 * tens + 11):

        async def use(head: XpsHead, silent_from: int = silent_from) -> None:
            silent_at_s: list[float] = []

            def lose(_request: bytes) -> bool:
                if len(head.wire.requests) >= silent_from:
                    silent_at_s.append(now_s())
                return bool(silent_at_s)

            head.wire.lose = lose
            with pytest.raises(NoAnswer):
                await work(head.driver())
            assert now_s() - silent_at_s[0] < 12

        with_xps(use)
