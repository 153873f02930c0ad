"""What every SCPI current source does, in each dialect: lost lines, second masters, the safe state."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, NamedTuple

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import CannotConnect, InstrumentFault, NoAnswer, Refused
from tests.support.source import Source6220, SourceGS200, SourceRig, now_s


class Words(NamedTuple):
    """How a dialect is made, and what it says: the end of a line, the way to 1.2 mA and 5 V, and what makes safe."""

    rig: Callable[[], SourceRig]
    end: bytes
    steps: tuple[bytes, ...]
    safe: bytes
    foreign: tuple[bytes, ...]


DIALECTS = {
    "keithley_6220": Words(
        Source6220, b"\r", (b"RANG:AUTO 0", b"RANG 0.02", b"COMP 5", b"CURR 0.0012", b"OUTP ON"),
        b":SOUR:CURR 0;:OUTP OFF", (b":SOUR:CURR 0.002", b":SOUR:CURR:COMP 9", b":OUTP OFF", b"*RST"),
    ),
    "yokogawa_gs200": Words(
        SourceGS200, b"\n", (b"FUNC CURR", b"RANG 0.01", b"VOLT 5", b"LEV 0.0012", b"OUTP 1"),
        b":SOUR:LEV 0;:OUTP 0", (b":SOUR:LEV 0.002", b":SOUR:PROT:VOLT 9", b":OUTP 0", b":SOUR:FUNC VOLT", b"*RST"),
    ),
}  # fmt: skip
each_dialect = pytest.mark.parametrize("words", DIALECTS.values(), ids=DIALECTS)
each_step = pytest.mark.parametrize(
    ("words", "step"),
    [pytest.param(words, step, id=step.decode()) for words in DIALECTS.values() for step in words.steps],
)


def with_each(words: Words, use: Callable[[SourceRig, Any], Awaitable[None]]) -> None:
    async def main() -> None:
        source = words.rig()
        async with source.driver() as driver:
            await use(source, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


@each_step
def test_a_command_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back(words: Words, step: bytes) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        source.wire.mute(step)
        await driver.set(0.0012, limit=5, output=True)
        assert [source.wire.count(each) for each in words.steps] == [1] * 5
        assert source.instrument.current_a == pytest.approx(0.0012)

    with_each(words, use)


@each_step
def test_a_command_that_is_lost_is_refused_and_not_repeated(words: Words, step: bytes) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        source.wire.lose = lambda request: step in request
        with pytest.raises(Refused, match=f"not executed; sent .*{step.decode()}"):
            await driver.set(0.0012, limit=5, output=True)
        assert source.wire.count(step) == 1
        assert source.instrument.current_a == 0

    with_each(words, use)


@pytest.mark.parametrize(
    ("words", "line"),
    [pytest.param(words, line, id=line.decode()) for words in DIALECTS.values() for line in words.foreign],
)
def test_a_second_master_is_a_fault_within_one_poll(words: Words, line: bytes) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.instrument.session().feed(line + words.end)
        with pytest.raises(InstrumentFault, match=r"was set to 0.0012 A in the 0.0[12] A range.*another master"):
            await driver.poll()

    with_each(words, use)


@each_dialect
def test_making_safe_is_at_once_though_a_question_is_not_answered(words: Words) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.mute(b"COND")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        source.wire.requests.clear()
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.05)
        assert source.wire.requests[0] == words.safe + words.end
        assert source.instrument.current_a == 0
        source.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="aborted, the instrument"):
            await poll
        await driver.make_safe()

    with_each(words, use)


@each_dialect
@pytest.mark.parametrize("requests", range(1, 12))
@pytest.mark.parametrize("later_s", [0.0, 0.01, 0.03, 0.06, 0.09])
def test_making_safe_ends_a_setting_wherever_it_is(words: Words, requests: int, later_s: float) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        opened = len(source.wire.requests)
        setting = asyncio.create_task(driver.set(0.0012, limit=5, output=True))
        await source.wire.heard(opened + requests)
        await asyncio.sleep(later_s)
        await driver.make_safe()
        await asyncio.gather(setting, return_exceptions=True)
        assert (source.instrument.level_a, source.instrument.output) == (0, False)
        safe = source.wire.requests.index(words.safe + words.end)
        assert not [request for request in source.wire.requests[safe:] if words.steps[-1] in request]

    with_each(words, use)


@each_dialect
def test_making_safe_connects_and_identifies_again(words: Words) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.wire.drop()
        await asyncio.sleep(0.1)
        start_s = now_s()
        await driver.make_safe()
        assert source.instrument.current_a == 0
        assert now_s() - start_s < 5
        assert len(source.wire.connections) == 2

    with_each(words, use)


@each_dialect
def test_what_cannot_be_made_safe_says_so_in_time(words: Words) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        await driver.set(0.0012, limit=5, output=True)
        source.faults.begin("stuck")
        with pytest.raises(Refused, match=f"not executed; sent {words.safe.decode().partition(';')[0]}"):
            await driver.make_safe()
        source.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5.001
        source.wire.drop()
        source.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_each(words, use)


async def while_it_lags(source: SourceRig, word: bytes, first: Awaitable[None], after_s: float) -> asyncio.Future[None]:
    """An order to an instrument that does it 0.7 s later, `after_s` after a word of it was sent."""
    sent = asyncio.Event()

    def lose(request: bytes) -> bool:
        if word in request:
            sent.set()
        return False

    source.wire.lose = lose
    source.faults.begin("lag")
    under_way = asyncio.ensure_future(first)
    await sent.wait()
    await asyncio.sleep(after_s)
    return under_way


@each_dialect
@pytest.mark.parametrize("after_s", [0.3, 0.65, 0.75])
def test_a_setting_that_another_one_ends_is_refused_even_when_its_last_step_shows(words: Words, after_s: float) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        on = driver.set(0.0012, limit=5, output=True)
        first = await while_it_lags(source, words.steps[-1], on, after_s)
        second = asyncio.ensure_future(driver.set(0.0024, limit=5, output=True))
        with pytest.raises(Refused, match="the setting was ended by another command"):
            await first
        while not second.done():
            await driver.poll()  # the first one's level is nothing that somebody else has changed
            await asyncio.sleep(0.05)
        await second
        assert source.instrument.current_a == pytest.approx(0.0024)

    with_each(words, use)


@each_dialect
def test_making_safe_that_is_proved_is_no_error_when_a_setting_ends_it(words: Words) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        await driver.set(0.0012, limit=5, output=True)
        zero = words.steps[3].partition(b" ")[0] + b" 0;"
        safe = await while_it_lags(source, zero, driver.make_safe(), 0.65)
        await driver.set(0.0, limit=5, output=False)
        await safe
        assert source.instrument.current_a == 0

    with_each(words, use)
