"""Decisions are taken on valid readings alone: waiting, soaking, measuring and interlocks on sensors that misbehave."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from bench.config.bench import load_bench
from bench.config.interlocks import ReadingInterlock
from bench.engine.channel import Channel, Rule
from bench.engine.interlocks import Interlocks
from bench.engine.measuring import _value_since
from bench.engine.monitor import Monitor
from bench.engine.waiting import soak, until
from bench.errors import StepError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Invalid, Valid, numbered
from bench.rig import Rig
from bench.sequence.waits import Soak, WaitUntil
from bench.store.writer import RunWriter
from drivers.values import Reading

BENCH = load_bench(Path(__file__).parents[2] / "config/simulated.yaml").bench
NAME, KEY = "unit_temperature", "Temperatures.Unit"
EVERY_S = 1.0
GIVE_UP = {"give_up_after": "20 s"}


class Sensor:
    """A device with one channel, which is asked every second and gives the next of these readings each time."""

    def __init__(self, polls: Iterable[Sequence[Reading]], key: str = KEY) -> None:
        self._polls, self._key = iter(polls), key

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        return {self._key: next(self._polls, ())}


def steadily(value_c: float, from_s: float = 0.0) -> Iterator[Sequence[Reading]]:
    """A sensor in order, with its noise."""
    for number in itertools.count():
        yield [Reading(from_s + number * EVERY_S, value_c + 0.01 * (number % 2))]


def then(begin: int, polls: Iterable[Sequence[Reading]], value_c: float = 20.0) -> Iterator[Sequence[Reading]]:
    """In order for some polls, then otherwise."""
    yield from itertools.islice(steadily(value_c), begin)
    yield from polls


def decided(tmp_path: Path, polls: Iterable[Sequence[Reading]], step: Any, begin_s: float = 5.5) -> tuple[Any, str]:
    """What a step finds of the sensor, None if it does not end, and the fault that the monitor has found."""
    writer = RunWriter(tmp_path)

    async def main() -> tuple[Any, str]:
        monitor = Monitor(Rig({"counter": Sensor(polls)}), BENCH, Interlocks({}, BENCH), writer, lambda *_: None)
        monitor.start()
        await asyncio.sleep(begin_s)
        stepping = asyncio.ensure_future(step(monitor))
        await asyncio.wait([stepping, monitor.fault], return_when=asyncio.FIRST_COMPLETED)
        found = stepping.result() if stepping.done() and not stepping.exception() else None
        told = str(stepping.exception() or "") if stepping.done() else ""
        stepping.cancel()
        await monitor.stop()
        return found, str(monitor.fault.result()) if monitor.fault.done() else told

    try:
        return run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()


def waiting(**condition: str) -> Any:
    step = WaitUntil.model_validate({"wait_until": NAME, **GIVE_UP, **condition})
    return lambda monitor: until(step, monitor)


def soaking(monitor: Monitor) -> Any:
    stable = {"band": "0.5 °C", "slope": "50 °C/h", "hold": "10 s"}
    given = {"soak": NAME, "at_least": "0 s", "until_stable": stable, "give_up_after": "40 s"}
    return soak(Soak.model_validate(given), monitor)


def measuring(monitor: Monitor) -> Any:
    return _value_since(asyncio.get_running_loop().time(), NAME, monitor)


BROKEN = {
    "not a number": lambda n: [Reading(n * EVERY_S, math.nan)],
    "infinite": lambda n: [Reading(n * EVERY_S, -math.inf if n % 2 else math.inf)],
    "impossible": lambda n: [Reading(n * EVERY_S, 999.0)],
    "jumps": lambda n: [Reading(n * EVERY_S, 80.0)],
    "silent": lambda n: [],
    "ahead": lambda n: [Reading(n * EVERY_S + 100.0, 80.0)],
    "behind": lambda n: [Reading(n * EVERY_S - 3.0, 20.0)],
}


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("condition", [{"above": "50 °C"}, {"below": "-50 °C"}, {"above": "10 °C", "hold": "15 s"}])
def test_no_condition_is_true_of_a_sensor_that_misbehaves(tmp_path: Path, kind: str, condition: dict[str, str]) -> None:
    polls = then(6, map(BROKEN[kind], itertools.count(6)))
    found, told = decided(tmp_path, polls, waiting(**condition))
    assert found is None
    assert NAME in told


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("step", [soaking, measuring])
def test_nothing_is_at_rest_or_measured_by_a_sensor_that_misbehaves(tmp_path: Path, kind: str, step: Any) -> None:
    polls = then(6, map(BROKEN[kind], itertools.count(6)))
    found, told = decided(tmp_path, polls, step)
    assert found is None
    assert NAME in told


def test_a_value_that_was_there_before_the_step_fulfils_no_condition(tmp_path: Path) -> None:
    found, _ = decided(tmp_path, then(6, itertools.repeat(()), 60.0), waiting(above="50 °C"))
    assert found is None


def test_a_sensor_in_order_decides(tmp_path: Path) -> None:
    found, _ = decided(tmp_path, steadily(60.0), waiting(above="50 °C", hold="5 s"))
    assert found["value"] == pytest.approx(60.0, abs=0.02)


def test_a_sensor_in_order_is_at_rest(tmp_path: Path) -> None:
    assert decided(tmp_path, steadily(60.0), soaking)[0]["temperature_c"] == pytest.approx(60.0, abs=0.02)


def test_one_bad_reading_holds_a_decision_up_until_the_next_good_one(tmp_path: Path) -> None:
    polls = then(6, [[Reading(6.0, math.nan)], *itertools.islice(steadily(60.0, 7.0), 20)], 60.0)
    found, _ = decided(tmp_path, polls, waiting(above="50 °C"))
    assert found["waited_s"] >= 1.0


def test_a_sensor_that_an_interlock_judges_cannot_fail_unnoticed(tmp_path: Path) -> None:
    """A thermometer that the bench file does not name may be unconnected; not one that an interlock relies on."""
    key = "Temperatures.Converter"
    entry = ReadingInterlock.model_validate({"reading": f"counter.{key}", "above": "60 °C", "then": "abort"})
    writer = RunWriter(tmp_path)

    async def main(interlocks: Interlocks) -> bool:
        polls = then(3, ([Reading(n * EVERY_S, math.nan)] for n in itertools.count(3)))
        monitor = Monitor(Rig({"counter": Sensor(polls, key)}), BENCH, interlocks, writer, lambda *_: None)
        monitor.start()
        await asyncio.sleep(20)
        await monitor.stop()
        return monitor.fault.done()

    try:
        assert run(main(Interlocks({"hot": entry}, BENCH)), AS_FAST_AS_POSSIBLE)
        assert not run(main(Interlocks({}, BENCH)), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()


def test_readings_are_numbered_in_the_order_in_which_they_came() -> None:
    channel = Channel("it", "V", Rule())
    accepted, rejected = channel.take([Reading(0.0, 1.0), Reading(1.0, math.nan), Reading(2.0, 1.0)])
    assert accepted == [Valid(0.0, 1.0, 1), Valid(2.0, 1.0, 3)]
    assert rejected == [Invalid(1.0, "was read as not-a-number", 2)]


def test_what_is_asked_for_one_by_one_and_is_no_number_is_an_error() -> None:
    assert numbered([Reading(1.0, 2.0)], "dvm", 7) == [Valid(1.0, 2.0, 7)]
    with pytest.raises(StepError, match="dvm: a reading was not a number"):
        numbered([Reading(1.0, math.nan)], "dvm", 1)


def test_what_is_invalid_has_no_value() -> None:
    assert not hasattr(Invalid(0.0, "is 40 s old", 1), "value")
