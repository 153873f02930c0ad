"""The driver of the Keithley 6220 against the simulated one, over a serial line in virtual time."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Source
from drivers.description import known_drivers
from drivers.dialects.keithley_6220.description import DESCRIPTION, KeithleyOptions
from drivers.dialects.keithley_6220.driver import Keithley6220
from drivers.errors import BeyondLimit, NoAnswer, Refused, WrongIdentity
from drivers.kinds.ranges import SourceLimits
from drivers.values import SourceReading
from tests.support.source import OPTIONS, Source6220, now_s, with_driver, with_source

# The bench file and connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["keithley_6220"] is DESCRIPTION
    options = KeithleyOptions.model_validate(OPTIONS)
    assert DESCRIPTION.channels_of(options) == {"current": "A"}
    assert (options.range, options.compliance, options.terminator) == (0.02, 10.0, "cr")


@pytest.mark.parametrize(
    ("model", "data", "problem"),
    [
        (KeithleyOptions, OPTIONS | {"range": "25 mA"}, "expected one of 2 nA to 20 mA in decades, or 100 mA"),
        (KeithleyOptions, OPTIONS | {"compliance": "106 V"}, "at most 105 V"),
        (KeithleyOptions, OPTIONS | {"compliance": "10 mA"}, "expected a quantity in V"),
        (KeithleyOptions, OPTIONS | {"terminator": "lfcr"}, "crlf"),
        (SourceLimits, {"current": {"min": "1 mA", "max": "1 mA"}}, "min is not below max"),
        (SourceLimits, {}, "missing"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(model: Any, data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        model.model_validate(data)


def test_it_identifies_itself() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        assert isinstance(driver, Source)
        identity = await driver.identify()
        assert (identity.maker, identity.model) == ("KEITHLEY INSTRUMENTS INC.", "MODEL 6220")
        assert (identity.serial, identity.firmware, identity.verified) == ("SIM-6220-01", "D04  /700x", True)
        assert source.commands() == []

    with_driver(use)


@pytest.mark.parametrize("terminator", ["cr", "lf", "crlf"])
def test_every_terminator_of_its_menu_can_be_used(terminator: Any) -> None:
    async def use(source: Source6220) -> None:
        async with source.driver(terminator=terminator) as driver:
            await driver.set(0.0012, limit=5, output=True)
        assert source.instrument.current_a == pytest.approx(0.0012)

    with_source(use, terminator=terminator)


def test_another_terminator_than_the_instruments_is_silence_with_a_hint() -> None:
    async def use(source: Source6220) -> None:
        with pytest.raises(NoAnswer, match="and the line terminator"):
            await source.driver(terminator="lf").__aenter__()

    with_source(use)


def test_another_source_is_refused() -> None:
    async def use(source: Source6220) -> None:
        with pytest.raises(WrongIdentity, match="serial is 'SIM-6220-02'"):
            await source.driver().__aenter__()

    with_source(use, serial="SIM-6220-02")


# Setting and reading


def test_range_compliance_and_level_are_set_before_the_output_goes_on() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        assert source.commands() == [
            b":SOUR:CURR:RANG:AUTO 0", b":SOUR:CURR:RANG 0.02", b":SOUR:CURR:COMP 5", b":SOUR:CURR 0.0012", b":OUTP ON",
        ]  # fmt: skip
        assert source.instrument.current_a == pytest.approx(0.0012)
        assert await driver.read() == SourceReading(None, 0.0012, True)
        (reading,) = (await driver.poll())["current"]
        assert reading == (pytest.approx(now_s()), 0.0012)

    with_driver(use)


def test_switching_off_goes_through_zero_and_keeps_the_range() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.requests.clear()
        await driver.set(0, limit=0, output=False)
        assert source.commands() == [b":SOUR:CURR 0", b":OUTP OFF"]
        assert await driver.read() == SourceReading(None, 0.0, False)
        assert (await driver.poll())["current"][0].value == 0
        source.wire.requests.clear()
        await driver.set(0.0144, limit=5, output=True)
        assert source.commands() == [b":SOUR:CURR 0.0144", b":OUTP ON"]

    with_driver(use)


def test_polarity_changes_through_zero() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.requests.clear()
        await driver.set(-0.0012, limit=5, output=True)
        assert source.commands() == [b":SOUR:CURR 0", b":SOUR:CURR -0.0012"]
        assert source.instrument.current_a == pytest.approx(-0.0012)

    with_driver(use)


def test_a_range_that_somebody_changed_is_put_back_at_zero_and_off() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        source.instrument.session().feed(b":SOUR:CURR:RANG 0.1;:SOUR:CURR 0.05;:OUTP ON\r")
        await driver.set(0.0012, limit=10, output=True)
        assert source.commands() == [
            b":SOUR:CURR 0", b":OUTP OFF", b":SOUR:CURR:RANG 0.02", b":SOUR:CURR 0.0012", b":OUTP ON",
        ]  # fmt: skip

    with_driver(use)


@pytest.mark.parametrize(
    ("level_a", "compliance_v", "problem"),
    [
        (0.0205, 5, "the level 0.0205 A is outside -0.02 A to 0.02 A"),
        (-0.0205, 5, "the level -0.0205 A"),
        (0.01, 10.5, "the compliance 10.5 V is outside 0.1 V to 10 V"),
        (0.01, 0.05, "the compliance 0.05 V"),
        (float("nan"), 5, "the level nan A"),
    ],
)
def test_beyond_the_limits_nothing_is_sent(level_a: float, compliance_v: float, problem: str) -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        sent = len(source.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.set(level_a, limit=compliance_v, output=True)
        assert len(source.wire.requests) == sent

    with_driver(use)


def test_the_range_bounds_the_level_as_well() -> None:
    async def use(source: Source6220) -> None:
        async with source.driver(range="2 mA") as driver:
            await driver.set(0.0021, limit=5, output=True)
            with pytest.raises(BeyondLimit, match=r"outside -0\.0021 A to 0\.0021 A"):
                await driver.set(0.0022, limit=5, output=True)

    with_source(use)


def test_a_source_that_carries_nothing_out_is_refused() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        source.faults.begin("stuck")
        with pytest.raises(Refused, match=r"received 0 A in the 0.1 A range, compliance 10 V, output off"):
            await driver.set(0.0012, limit=10, output=True)

    with_driver(use)


def test_errors_of_the_instrument_are_quoted_until_its_queue_is_empty() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        source.wire.alter = lambda request, answer: (
            b'+400,"Calibration"\r' if request.startswith(b":SOUR:CURR:COMP 5;") else answer
        )
        source.instrument.session().feed(b"NONSENSE\r")
        with pytest.raises(Refused, match='received -113,"Undefined header"'):
            await driver.set(0.0012, limit=5, output=True)
        with pytest.raises(Refused, match=r'sent :SOUR:CURR:COMP 5; received \+?400,"Calibration"'):
            await driver.set(0.0012, limit=5, output=True)

    with_driver(use)


def test_a_second_setting_ends_the_first() -> None:
    async def use(source: Source6220, driver: Keithley6220) -> None:
        first = asyncio.create_task(driver.set(0.0012, limit=5, output=True))
        await asyncio.sleep(0.005)
        await driver.set(0.0014, limit=5, output=True)
        with pytest.raises(Refused, match="ended by another command"):
            await first
        assert (await driver.read()).current_a == 0.0014
        await driver.poll()

    with_driver(use)
