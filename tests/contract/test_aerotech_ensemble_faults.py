"""The driver of the Aerotech Ensemble: faults, stopping, the safe state."""

import asyncio

import pytest

from drivers.aerotech_ensemble.driver import AerotechEnsemble
from drivers.aerotech_ensemble.wire import AxisFault
from drivers.errors import (
    CannotConnect,
    InstrumentFault,
    NoAnswer,
    Refused,
)
from tests.support.head import Head, now_s, with_driver, with_head

# Faults


def test_a_fault_is_named_and_never_acknowledged() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        await driver.move_to(10, approach="direct", settle_s=0)
        head.controller.trip(AxisFault.EMERGENCY_STOP | AxisFault.OVER_CURRENT)
        words = "has a fault: over current, emergency stop; received AXISFAULT 0x802.*FAULTACK"
        with pytest.raises(InstrumentFault, match=words):
            await driver.poll()
        with pytest.raises(InstrumentFault, match=words):
            await driver.move_to(20, approach="direct", settle_s=0)
        assert head.moves() == ["10.0"]
        assert head.wire.count(b"FAULTACK") == 0

    with_driver(use)


def test_a_fault_during_a_move_ends_it() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        asyncio.get_running_loop().call_later(1.0, head.controller.trip, AxisFault.POSITION_ERROR)
        with pytest.raises(InstrumentFault, match="position error"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() < 1.3

    with_driver(use)


def test_a_move_beyond_the_controllers_own_limits_is_its_fault() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        with pytest.raises(InstrumentFault, match=r"positive software limit; sent MOVEABS X 100\.0 F20"):
            await driver.move_to(100, approach="direct", settle_s=0)

    with_driver(use, software_limits_deg=(-90.0, 90.0))


def test_an_axis_that_is_disabled_during_a_move_is_a_fault() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        asyncio.get_running_loop().call_later(1.0, head.controller.execute, b"DISABLE X")
        with pytest.raises(InstrumentFault, match="was disabled on its way to 40°"):
            await driver.move_to(40, approach="direct", settle_s=0)

    with_driver(use)


def test_somebody_else_moving_the_axis_is_a_fault_within_one_poll() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        await driver.poll()  # nothing is expected of it yet
        await driver.move_to(10, approach="direct", settle_s=0)
        head.controller.execute(b"MOVEABS X 10.001 F5")
        await driver.poll()  # within ten bands
        head.controller.execute(b"MOVEABS X 12.0 F5")
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"stands at 12\.00000°, it was sent to 10\.00000°.*who else"):
            await driver.poll()
        await driver.stop()
        await driver.poll()

    with_driver(use)


# Stopping and the safe state


@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_stopping_ends_the_move_under_way(ending: str) -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        move = asyncio.create_task(driver.move_to(100, approach="from_above", settle_s=0))
        await asyncio.sleep(2.05)
        await getattr(driver, ending)()
        assert not head.moving
        stood_deg = head.angle_deg
        with pytest.raises(Refused, match=r"ended by another command|cut short"):
            await move
        await asyncio.sleep(10)
        assert head.angle_deg == stood_deg
        assert head.moves() == ["102.0"]
        assert head.controller.enabled

    with_driver(use)


def test_making_safe_stops_at_once_while_a_question_is_under_way() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        move = asyncio.create_task(driver.move_to(300, approach="direct", settle_s=0))
        await asyncio.sleep(1)
        head.wire.mute(b"PFBK")
        await asyncio.sleep(1)
        start_s, before_deg = now_s(), head.angle_deg
        await driver.make_safe()
        assert now_s() - start_s < 5
        assert head.angle_deg - before_deg < 0.1
        with pytest.raises(Refused, match="cut short"):
            await move

    with_driver(use)


def test_making_safe_is_idempotent_and_legal_in_any_state() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        await driver.make_safe()
        head.controller.trip(AxisFault.ENCODER)
        await driver.make_safe()
        await driver.make_safe()
        assert head.moves() == []
        assert head.wire.count(b"HOME") == 0

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        await driver.stop()
        head.controller.execute(b"ENABLE X")
        head.controller.execute(b"MOVEABS X 300.0 F20")
        head.wire.drop()
        await asyncio.sleep(1)
        assert head.moving
        await driver.make_safe()
        assert not head.moving
        assert len(head.wire.connections) == 2
        await driver.angle()

    with_driver(use)


def test_making_safe_before_it_was_ever_connected() -> None:
    async def use(head: Head) -> None:
        driver = head.driver()
        head.controller.execute(b"ENABLE X")
        head.controller.execute(b"MOVEABS X 300.0 F20")
        await driver.make_safe()
        assert not head.moving
        await driver.__aexit__()

    with_head(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
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

    with_driver(use)


def test_an_axis_that_does_not_stop_is_not_proved_safe() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda request, answer: b"%11\n" if request.startswith(b"AXISSTATUS") else answer
        start_s = now_s()
        with pytest.raises(NoAnswer, match="is not proved safe within 5 s"):
            await driver.make_safe()
        assert now_s() - start_s == pytest.approx(5)

    with_driver(use)


async def work(driver: AerotechEnsemble) -> None:
    async with driver:
        await driver.move_to(40, approach="from_above", settle_s=1)
        for _ in range(200):
            await driver.poll()
            await asyncio.sleep(1)


@pytest.mark.parametrize("tens", range(20))
def test_silence_is_reported_within_a_deadline_whenever_it_begins(tens: int) -> None:
    for silent_from in range(10 * tens + 1, 10 * tens + 11):

        async def use(head: Head, silent_from: int = silent_from) -> None:
            silent_at_s: list[float] = []

            def lose(_request: bytes) -> bool:
                if len(head.wire.requests) >= silent_from:
                    silent_at_s.append(now_s())
                return bool(silent_at_s)

            head.wire.lose = lose
            with pytest.raises(NoAnswer):
                await work(head.driver())
            assert now_s() - silent_at_s[0] < 10

        with_head(use)
