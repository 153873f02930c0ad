"""The driver of the Keithley 6220: faults and the safe state."""

import asyncio

import pytest

from drivers.errors import (
    CannotConnect,
    InstrumentFault,
    NoAnswer,
    Refused,
)
from drivers.keithley_6220.driver import Keithley6220
from tests.support.source import Source6220, now_s, with_driver

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
        with pytest.raises(InstrumentFault, match=r"too hot.*cool down"):
            await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("line", [b":SOUR:CURR 0.002\r", b":SOUR:CURR:COMP 9\r", b":OUTP OFF\r", b"*RST\r"])
def test_a_second_master_is_a_fault_within_one_poll(line: bytes) -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.session().feed(line)
        with pytest.raises(InstrumentFault, match=r"was set to 0.0012 A in the 0.02 A range.*who else sets it"):
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


def test_making_safe_is_at_once_though_a_question_is_not_answered() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.mute(b"COND")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.05)
        assert source.instrument.current_a == 0
        source.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="cut short"):
            await poll

    with_driver(use)


@pytest.mark.parametrize("requests", range(1, 12))
@pytest.mark.parametrize("later_s", [0.0, 0.01, 0.03, 0.06, 0.09])
def test_making_safe_ends_a_setting_wherever_it_is(requests: int, later_s: float) -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        opened = len(source.wire.requests)
        setting = asyncio.create_task(driver.set(0.0012, limit=5, output=True))
        await source.wire.heard(opened + requests)
        await asyncio.sleep(later_s)
        await driver.make_safe()
        await asyncio.gather(setting, return_exceptions=True)
        assert (source.instrument.level_a, source.instrument.output) == (0, False)
        safe = source.wire.requests.index(b":SOUR:CURR 0;:OUTP OFF\r")
        assert not [request for request in source.wire.requests[safe:] if b"OUTP ON" in request]

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.drop()
        await asyncio.sleep(0.1)
        start_s = now_s()
        await driver.make_safe()
        assert source.instrument.current_a == 0
        assert now_s() - start_s < 5
        assert len(source.wire.connections) == 2

    with_driver(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.faults.begin("stuck")
        with pytest.raises(Refused, match="not carried out; sent :SOUR:CURR 0"):
            await driver.make_safe()
        source.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        source.wire.drop()
        source.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use)
