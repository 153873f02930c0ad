"""The driver of the Yokogawa GS200: faults and the safe state."""

import asyncio

import pytest

from drivers.errors import InstrumentFault, NoAnswer, Refused
from drivers.yokogawa_gs200.driver import YokogawaGS200
from tests.support.source import SourceGS200, now_s, with_gs200


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


@pytest.mark.parametrize("line", [b":SOUR:LEV 0.002\n", b":SOUR:PROT:VOLT 9\n", b":OUTP 0\n", b":SOUR:FUNC VOLT\n"])
def test_a_second_master_is_a_fault_within_one_poll(line: bytes) -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.session().feed(line)
        with pytest.raises(InstrumentFault, match="who else sets it"):
            await driver.poll()

    with_gs200(use)


def test_volts_at_its_output_are_a_fault_until_it_is_made_safe() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        source.instrument.session().feed(b":SOUR:FUNC VOLT;:SOUR:LEV 5;:OUTP 1\n")
        with pytest.raises(InstrumentFault, match="gives a voltage"):
            await driver.poll()
        with pytest.raises(InstrumentFault, match=r"gives a voltage.*Make it safe"):
            await driver.set(0.0012, limit=5, output=True)
        await driver.make_safe()
        assert (source.instrument.level_a, source.instrument.output) == (0, False)
        await driver.set(0.0012, limit=5, output=True)
        assert source.instrument.current_a == pytest.approx(0.0012)

    with_gs200(use)


def test_making_safe_goes_to_zero_then_off_at_once_and_proves_it() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.mute(b"FUNC?")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        source.wire.requests.clear()
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.05)
        assert source.wire.requests[0] == b":SOUR:LEV 0;:OUTP 0\n"
        assert source.instrument.current_a == 0
        source.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="cut short"):
            await poll
        await driver.make_safe()

    with_gs200(use)


@pytest.mark.parametrize("requests", range(1, 12))
def test_making_safe_ends_a_setting_wherever_it_is(requests: int) -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        opened = len(source.wire.requests)
        setting = asyncio.create_task(driver.set(0.0012, limit=5, output=True))
        await source.wire.heard(opened + requests)
        await driver.make_safe()
        await asyncio.gather(setting, return_exceptions=True)
        assert (source.instrument.level_a, source.instrument.output) == (0, False)

    with_gs200(use)


def test_making_safe_connects_again_and_a_silent_source_is_told_in_time() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.drop()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert source.instrument.current_a == 0
        assert len(source.wire.connections) == 2
        source.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5

    with_gs200(use)
