"""The driver of the Keithley 6220: faults and the safe state."""

import pytest

from drivers.dialects.keithley_6220.driver import Keithley6220
from drivers.errors import InstrumentFault
from tests.support.source import Source6220, with_driver

# Faults


def test_an_open_load_is_a_fault_when_it_is_energised() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        with pytest.raises(InstrumentFault, match=r"in compliance: the load does not take the current.*Check the load"):
            await driver.set(0.0012, limit=5, output=True)
        with pytest.raises(InstrumentFault, match="in compliance"):
            await driver.poll()
        await driver.make_safe()
        await driver.poll()

    with_driver(use, load_ohm=1e9)


def test_a_load_that_opens_later_is_a_fault_within_one_poll() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        await driver.poll()
        source.instrument.load_ohm = 1e9
        for _ in range(2):
            with pytest.raises(InstrumentFault, match=r"in compliance.*measurement condition 8"):
                await driver.poll()

    with_driver(use)


def test_an_open_interlock_keeps_it_off() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        source.instrument.interlock_closed = False
        await driver.poll()  # nothing is to flow
        with pytest.raises(InstrumentFault, match=r"its interlock is open.*Close the interlock"):
            await driver.set(0.0012, limit=5, output=True)
        assert source.commands() == []

    with_driver(use)


def test_an_interlock_that_opens_later_is_a_fault_within_one_poll() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.interlock_closed = False
        with pytest.raises(InstrumentFault, match="its interlock is open"):
            await driver.poll()

    with_driver(use)


def test_over_temperature_is_a_fault_always() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        source.instrument.hot = True
        with pytest.raises(InstrumentFault, match=r"over-temperature.*cool down"):
            await driver.poll()

    with_driver(use)


# The safe state


def test_making_safe_goes_to_zero_then_off_and_proves_it() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.requests.clear()
        await driver.make_safe()
        assert source.wire.requests[0] == b":SOUR:CURR 0;:OUTP OFF\r"
        assert (source.instrument.level_a, source.instrument.output) == (0, False)
        await driver.make_safe()
        await driver.poll()
        source.instrument.session().feed(b":OUTP ON\r")
        with pytest.raises(InstrumentFault, match=r"output off; received .* output on"):
            await driver.poll()

    with_driver(use)
