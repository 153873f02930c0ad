"""The driver of the Yokogawa GS200: faults and the safe state."""

import pytest

from drivers.dialects.yokogawa_gs200.driver import YokogawaGS200
from drivers.errors import InstrumentFault
from tests.support.source import SourceGS200, with_gs200


def test_a_trip_is_a_fault_within_one_poll() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.trip()
        with pytest.raises(InstrumentFault, match=r"was set to 0.0012 A in the 0.01 A range.*output off.*for a trip"):
            await driver.poll()

    with_gs200(use)


def test_an_open_load_is_a_fault_when_it_is_energised_and_later() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        await driver.poll()
        source.instrument.load_ohm = 1e9
        with pytest.raises(InstrumentFault, match=r"at its voltage limit.*condition 2048.*Check the load"):
            await driver.poll()
        await driver.make_safe()
        with pytest.raises(InstrumentFault, match=r"at its voltage limit.*condition 1024"):
            await driver.set(-0.0012, limit=5, output=True)
        await driver.make_safe()
        await driver.poll()

    with_gs200(use)


def test_an_emergency_is_a_fault_always() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        source.instrument.emergency = True
        with pytest.raises(InstrumentFault, match=r"an emergency; received condition 8192"):
            await driver.poll()

    with_gs200(use)


def test_a_power_failure_is_a_fault_within_one_poll() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.restart()
        with pytest.raises(InstrumentFault, match="a power failure"):
            await driver.poll()

    with_gs200(use)


def test_volts_at_its_output_are_a_fault_until_it_is_made_safe() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        source.instrument.session().feed(b":SOUR:FUNC VOLT;:SOUR:LEV 5;:OUTP 1\n")
        with pytest.raises(InstrumentFault, match="in voltage mode"):
            await driver.poll()
        with pytest.raises(InstrumentFault, match=r"in voltage mode.*Make it safe"):
            await driver.set(0.0012, limit=5, output=True)
        await driver.make_safe()
        assert (source.instrument.level_a, source.instrument.output) == (0, False)
        await driver.set(0.0012, limit=5, output=True)
        assert source.instrument.current_a == pytest.approx(0.0012)

    with_gs200(use)
