"""The driver of the Fluke 5700A against the simulated one, over a serial line in virtual time."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Source
from drivers.description import known_drivers
from drivers.dialects.fluke_5700a.description import DESCRIPTION, FlukeOptions
from drivers.dialects.fluke_5700a.driver import Fluke5700A
from drivers.errors import BadAnswer, BeyondLimit, Refused, WrongIdentity
from drivers.kinds.ranges import SourceLimits
from drivers.values import SourceReading
from tests.support.calibrator import OPTIONS, Calibrator, now_s, with_calibrator, with_driver

CHOOSE_RANGE = [b"OUT 0.00231 A, 0 HZ", b"RANGELCK ON"]

# The bench file and connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["fluke_5700a"] is DESCRIPTION
    options = FlukeOptions.model_validate(OPTIONS)
    assert DESCRIPTION.channels_of(options) == {"current": "A", "settled": "", "on_time": "s"}
    assert (options.range, options.compliance, options.settle_within, options.terminator) == (0.022, 10.0, 15.0, "crlf")


@pytest.mark.parametrize(
    ("model", "data", "problem"),
    [
        (FlukeOptions, OPTIONS | {"range": "20 mA"}, "expected 220 µA, 2.2 mA, 22 mA, 220 mA or 2.2 A"),
        (FlukeOptions, OPTIONS | {"compliance": "0 V"}, "more than 0 V"),
        (FlukeOptions, {"range": "22 mA"}, "missing"),
        (FlukeOptions, OPTIONS | {"settle_within": "0 s"}, "more than 0 s"),
        (FlukeOptions, OPTIONS | {"terminator": "lfcr"}, "crlf"),
        (SourceLimits, {"current": {"min": "1 mA", "max": "1 mA"}}, "min is not below max"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(model: Any, data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        model.model_validate(data)


def test_it_identifies_itself_and_changes_nothing() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        assert isinstance(driver, Source)
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("FLUKE", "5720A", "SIM-5720A-01")
        assert (identity.firmware, identity.verified) == ("1.4+A,1.1,0.0", True)
        await driver.poll()
        assert source.commands() == []
        assert not source.instrument.remote

    with_driver(use)


@pytest.mark.parametrize("terminator", ["cr", "lf", "crlf"])
def test_every_terminator_of_its_menu_can_be_used(terminator: Any) -> None:
    async def use(source: Calibrator) -> None:
        async with source.driver(terminator=terminator) as driver:
            await driver.set(0.0012, limit=10, output=True)
        assert source.instrument.current_a == 0.0012

    with_calibrator(use, terminator=terminator)


@pytest.mark.parametrize("model", ["5700A", "5720A", "5730A"])
def test_each_model_of_the_family_is_taken(model: str) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        assert (await driver.identify()).model == model

    with_driver(use, model=model)


@pytest.mark.parametrize(
    ("settings", "problem"),
    [({"serial": "SIM-5720A-02"}, "serial is 'SIM-5720A-02'"), ({"model": "5502A"}, "a 5502A is none of 5700A, 5720A")],
)
def test_another_calibrator_is_refused(settings: dict[str, str], problem: str) -> None:
    async def use(source: Calibrator) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await source.driver().__aenter__()

    with_calibrator(use, **settings)


def test_another_calibrator_that_takes_its_place_is_refused() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.wire.alter = lambda request, answer: answer.replace(b"1.4+A", b"1.5+A")
        with pytest.raises(WrongIdentity, match="another instrument has taken its place"):
            await driver.identify()

    with_driver(use)


def test_a_terminal_mode_is_told_with_what_to_do() -> None:
    async def use(source: Calibrator) -> None:
        source.instrument.terminal = True
        with pytest.raises(BadAnswer, match=r"received '\*IDN\?'.*set its remote interface to COMPUTER"):
            await source.driver().__aenter__()
        assert source.commands() == []

    with_calibrator(use)


def test_one_that_falls_into_terminal_mode_is_not_believed() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.instrument.terminal = True
        with pytest.raises(BadAnswer, match="ISR"):
            await driver.poll()

    with_driver(use)


# Setting and reading


def test_the_range_is_locked_in_standby_and_the_level_set_before_it_operates() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        assert source.commands() == [b"REMOTE", *CHOOSE_RANGE, b"OUT 0.0012 A, 0 HZ", b"OPER"]
        assert (source.instrument.current_a, source.instrument.range_a) == (0.0012, 0.022)
        assert await driver.read() == SourceReading(None, 0.0012, True)
        readings = await driver.poll()
        assert readings["current"][0] == (pytest.approx(now_s()), 0.0012)
        assert readings["settled"][0].value == 1

    with_driver(use)


def test_it_returns_when_the_output_has_settled() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.settle_s = 7.3
        setting = asyncio.create_task(driver.set(0.0012, limit=10, output=True))
        await asyncio.sleep(5)
        readings = await driver.poll()
        assert (readings["current"][0].value, readings["settled"][0].value) == (0.0012, 0)
        assert not setting.done()
        await setting
        begun_s = now_s()
        await driver.set(0.0144, limit=10, output=True)
        assert 7.3 < now_s() - begun_s < 9.5

    with_driver(use)


def test_a_settled_bit_that_is_still_that_of_the_level_before_is_not_believed() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        stale_until_s = now_s() + 0.5
        source.wire.alter = lambda request, answer: (
            b"6177\r\n" if request == b"ISR?\r\n" and now_s() < stale_until_s else answer
        )
        await driver.set(0.0144, limit=10, output=True)
        assert (await driver.poll())["settled"][0].value == 1
        assert now_s() - stale_until_s > 2

    with_driver(use)


def test_the_next_level_keeps_the_range_and_goes_on_operating() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.requests.clear()
        await driver.set(0.0144, limit=10, output=True)
        await driver.set(-0.0144, limit=10, output=True)
        assert source.commands() == [b"OUT 0.0144 A, 0 HZ", b"OUT 0 A, 0 HZ", b"OUT -0.0144 A, 0 HZ"]
        assert source.instrument.range_a == 0.022

    with_driver(use)


def test_switching_off_goes_through_zero_and_keeps_the_range() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.wire.requests.clear()
        await driver.set(0, limit=0, output=False)
        assert source.commands() == [b"OUT 0 A, 0 HZ", b"STBY"]
        assert await driver.read() == SourceReading(None, 0.0, False)
        readings = await driver.poll()
        assert (readings["current"][0].value, readings["settled"][0].value) == (0, 0)
        source.wire.requests.clear()
        await driver.set(0.0144, limit=10, output=True)
        assert source.commands() == [b"OUT 0.0144 A, 0 HZ", b"OPER"]

    with_driver(use)


def test_what_another_program_left_on_goes_to_zero_and_standby_before_its_range_changes() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.at_the_panel(b"OUT 0.05 A, 0 HZ;RANGELCK ON;OPER")
        await driver.set(0.0012, limit=10, output=True)
        assert source.commands() == [
            b"REMOTE", b"OUT 0 A, 0 HZ", b"STBY", b"RANGELCK OFF", *CHOOSE_RANGE, b"OUT 0.0012 A, 0 HZ", b"OPER",
        ]  # fmt: skip

    with_driver(use)


def test_a_range_that_somebody_freed_is_chosen_again() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.set(0.0012, limit=10, output=True)
        source.at_the_panel(b"RANGELCK OFF")
        source.wire.requests.clear()
        await driver.set(0.0012, limit=10, output=True)
        assert source.commands() == [b"OUT 0 A, 0 HZ", b"STBY", *CHOOSE_RANGE, b"OUT 0.0012 A, 0 HZ", b"OPER"]

    with_driver(use)


@pytest.mark.parametrize(
    ("level_a", "compliance_v", "problem"),
    [
        (0.0205, 10, "the level 0.0205 A is outside -0.02 A to 0.02 A"),
        (-0.0205, 10, r"the level -0.0205 A"),
        (float("nan"), 10, "the level nan A"),
        (0.01, 5, "the compliance is 10 V and cannot be set to 5 V"),
        (0.01, 12, "the compliance is 10 V and cannot be set to 12 V"),
    ],
)
def test_beyond_the_limits_nothing_is_sent(level_a: float, compliance_v: float, problem: str) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        sent = len(source.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.set(level_a, limit=compliance_v, output=True)
        assert len(source.wire.requests) == sent

    with_driver(use)


def test_the_range_bounds_the_level_as_well() -> None:
    async def use(source: Calibrator) -> None:
        async with source.driver(range="2.2 mA") as driver:
            await driver.set(0.0021, limit=10, output=True)
            with pytest.raises(BeyondLimit, match=r"outside -0\.0022 A to 0\.0022 A"):
                await driver.set(0.0023, limit=10, output=True)

    with_calibrator(use)


STEPS = [b"REMOTE", *CHOOSE_RANGE, b"OUT 0.0012 A", b"OPER"]


@pytest.mark.parametrize("word", STEPS)
def test_a_command_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back(word: bytes) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.wire.mute(word)
        await driver.set(0.0012, limit=10, output=True)
        assert [source.wire.count(step) for step in STEPS] == [1] * 5
        assert source.instrument.current_a == 0.0012

    with_driver(use)


@pytest.mark.parametrize("word", STEPS)
def test_a_command_that_is_lost_is_refused_and_not_repeated(word: bytes) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.wire.lose = lambda request: word in request
        with pytest.raises(Refused, match=f"not executed; sent {word.decode()}"):
            await driver.set(0.0012, limit=10, output=True)
        assert source.wire.count(word) == 1
        assert source.instrument.current_a == 0

    with_driver(use)


def test_slow_relays_are_waited_for() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.instrument.relay_s = 1.5
        await driver.set(0.0012, limit=10, output=True)
        await driver.set(0, limit=0, output=False)
        assert source.wire.count(b"OPER") == source.wire.count(b"STBY") == 1

    with_driver(use)


def test_one_that_carries_nothing_out_is_refused() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        source.faults.begin("stuck")
        with pytest.raises(Refused, match=r"sent OUT 0.00231 A, 0 HZ; received no DC current, in standby, remote"):
            await driver.set(0.0012, limit=10, output=True)

    with_driver(use)


def test_a_second_setting_ends_the_first() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        for later_s in (0.005, 0.3, 1.0, 2.0, 3.0):
            first = asyncio.create_task(driver.set(0.0012, limit=10, output=True))
            await asyncio.sleep(later_s)
            await driver.set(0.0014, limit=10, output=True)
            with pytest.raises(Refused, match="ended by another command"):
                await first
            assert (await driver.read()).current_a == 0.0014
            await driver.poll()

    with_driver(use)


def test_what_waits_for_an_answer_always_fits_the_input_buffer() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        waiting = most = 0

        def tap(request: bytes, answer: bytes) -> bytes:
            nonlocal waiting, most
            most = max(most, waiting := waiting + len(request))
            waiting = 0 if answer else waiting
            return answer

        source.wire.alter = tap
        for level_a in (0.0012, -0.0123456789):
            await driver.set(level_a, limit=10, output=True)
        await driver.poll()
        setting = asyncio.create_task(driver.set(-0.0123, limit=10, output=True))
        await asyncio.sleep(0.02)
        await driver.make_safe()
        with pytest.raises(Refused):
            await setting
        assert 0 < most < 128

    with_driver(use)


# Warm-up


async def on_time_s(driver: Fluke5700A) -> float:
    return (await driver.poll())["on_time"][0].value


@pytest.mark.parametrize("begin_s", [0, 1, 30, 59])
def test_on_time_is_never_more_than_the_power_was_seen_to_be_on(begin_s: float) -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await asyncio.sleep(begin_s)
        begun_s = now_s()
        assert await on_time_s(driver) == 0  # though it has been on for 123456 minutes of its life
        for wait_s in (59, 61, 600, 7200):
            await asyncio.sleep(wait_s)
            reported_s, was_s = await on_time_s(driver), now_s() - begun_s
            assert was_s - 121 < reported_s <= was_s

    with_driver(use)


def test_a_power_failure_begins_the_warm_up_anew() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.poll()
        await asyncio.sleep(7300)
        assert await on_time_s(driver) >= 7140
        source.instrument.restart()
        assert await on_time_s(driver) == 0
        await asyncio.sleep(600)
        assert 400 < await on_time_s(driver) <= 600

    with_driver(use)


def test_a_wire_that_is_connected_again_keeps_the_warm_up() -> None:
    async def use(source: Calibrator, driver: Fluke5700A) -> None:
        await driver.poll()
        await asyncio.sleep(7300)
        source.wire.drop()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert await on_time_s(driver) >= 7140
        source.wire.drop()
        source.instrument.restart()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert await on_time_s(driver) == 0

    with_driver(use)
