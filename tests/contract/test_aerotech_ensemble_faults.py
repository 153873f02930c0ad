"""The driver of the Aerotech Ensemble: faults, stopping, the safe state."""

import asyncio

import pytest

from drivers.dialects.aerotech_ensemble.axis import AerotechEnsemble
from drivers.dialects.aerotech_ensemble.wire import AxisFault
from drivers.errors import InstrumentFault, NoAnswer
from tests.support.head import Head, now_s, with_driver

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
        with pytest.raises(InstrumentFault, match="was disabled during the move to 40°"):
            await driver.move_to(40, approach="direct", settle_s=0)

    with_driver(use)


# Stopping and the safe state


def test_making_safe_is_idempotent_and_legal_in_any_state() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        await driver.make_safe()
        head.controller.trip(AxisFault.ENCODER)
        await driver.make_safe()
        await driver.make_safe()
        assert head.moves() == []
        assert head.wire.count(b"HOME") == 0

    with_driver(use)


def test_an_axis_that_does_not_stop_is_not_proved_safe() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda request, answer: b"%11\n" if request.startswith(b"AXISSTATUS") else answer
        start_s = now_s()
        with pytest.raises(NoAnswer, match=r"is not proved safe within 5\.75 s"):
            await driver.make_safe()
        assert now_s() - start_s == pytest.approx(5.75)

    with_driver(use)
