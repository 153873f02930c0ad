"""The driver of the Yokogawa GS200 against the simulated one, over TCP in virtual time."""

from typing import Any

import pytest
from pydantic import ValidationError

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.capabilities import Source
from drivers.description import known_drivers
from drivers.dialects.yokogawa_gs200.description import DESCRIPTION, GS200Options
from drivers.dialects.yokogawa_gs200.driver import YokogawaGS200
from drivers.errors import BeyondLimit, Refused, WrongIdentity
from drivers.values import SourceReading
from tests.support.source import GS200_OPTIONS, SourceGS200, with_gs200


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["yokogawa_gs200"] is DESCRIPTION
    options = GS200Options.model_validate(GS200_OPTIONS)
    assert (options.range, options.compliance, DESCRIPTION.channels_of(options)) == (0.01, 10.0, {"current": "A"})


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"range": "20 mA"}, "expected 1, 10, 100 or 200 mA"),
        ({"compliance": "31 V"}, "at most 30 V"),
        ({"compliance": "0.5 V"}, "at least 1 V"),
        ({"compliance": "4.5 V"}, "expected whole volts"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(changed: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        GS200Options.model_validate(GS200_OPTIONS | changed)


def test_it_identifies_itself() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        assert isinstance(driver, Source)
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("YOKOGAWA", "GS210", "SIM-GS200-01")
        assert source.commands() == []

    with_gs200(use)


def test_another_source_is_refused() -> None:
    async def main() -> None:
        with pytest.raises(WrongIdentity, match="serial is 'SIM-GS200-02'"):
            await SourceGS200(serial="SIM-GS200-02").driver().__aenter__()

    run(main(), AS_FAST_AS_POSSIBLE)


def test_out_of_the_box_it_is_made_a_current_source_before_the_output_goes_on() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.012, limit=5, output=True)
        assert source.commands() == [
            b":SOUR:FUNC CURR", b":SOUR:RANG 0.01", b":SOUR:PROT:VOLT 5", b":SOUR:LEV 0.012", b":OUTP 1",
        ]  # fmt: skip
        assert source.instrument.current_a == pytest.approx(0.012)
        assert await driver.read() == SourceReading(None, 0.012, True)
        (reading,) = (await driver.poll())["current"]
        assert reading.value == 0.012

    with_gs200(use)


def test_polarity_and_off_go_through_zero() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.requests.clear()
        await driver.set(-0.0012, limit=5, output=True)
        await driver.set(0, limit=0, output=False)
        assert source.commands() == [b":SOUR:LEV 0", b":SOUR:LEV -0.0012", b":SOUR:LEV 0", b":OUTP 0"]
        assert await driver.read() == SourceReading(None, 0.0, False)
        await driver.poll()

    with_gs200(use)


@pytest.mark.parametrize(
    ("level_a", "compliance_v", "problem"),
    [
        (0.01201, 5, r"the level 0.01201 A is outside -0\.012 A to 0\.012 A"),
        (float("nan"), 5, "the level nan A"),
        (0.01, 11, "the compliance 11 V is outside 1 V to 10 V"),
        (0.01, 4.5, "the compliance 4.5 V is not in whole volts"),
        (0.01, float("nan"), "the compliance nan V"),
    ],
)
def test_beyond_the_limits_nothing_is_sent(level_a: float, compliance_v: float, problem: str) -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        sent = len(source.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.set(level_a, limit=compliance_v, output=True)
        assert len(source.wire.requests) == sent

    with_gs200(use)


def test_the_largest_range_gives_no_more_than_its_name() -> None:
    async def main() -> None:
        async with SourceGS200().driver(range="200 mA") as driver:
            assert driver._bounds.max_a == pytest.approx(0.2)

    run(main(), AS_FAST_AS_POSSIBLE)


def test_errors_of_the_instrument_are_quoted_until_its_queue_is_empty() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        source.instrument.session().feed(b"NONSENSE\nSOUR:LEV x\n")
        with pytest.raises(Refused, match='received -113,"Undefined header"; -104,"Data type error"'):
            await driver.set(0.0012, limit=5, output=True)
        await driver.set(0.0012, limit=5, output=True)

    with_gs200(use)


def test_one_that_knows_only_the_question_of_its_maker_is_used_all_the_same() -> None:
    async def use(source: SourceGS200, driver: YokogawaGS200) -> None:
        await driver.set(5e-3, limit=10.0, output=True)
        assert await driver.read() == SourceReading(None, 5e-3, True)
        source.instrument.put_output(False)
        await driver.make_safe()
        assert source.wire.count(b":SYST:ERR?") == 2

    with_gs200(use, error_queries=("STATus:ERRor?",))
