"""No step, interlock, window or result decides on a reading that is invalid or stale, and the end names the cause."""

from __future__ import annotations

import ast
import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bench.config.bench import load_bench
from bench.engine.channel import Channel, Rule
from bench.engine.context import Bench
from bench.engine.interlocks import Interlocks
from bench.engine.journal import Journal
from bench.engine.measuring import measure
from bench.engine.monitor import Monitor
from bench.engine.outputs import acquire_into
from bench.engine.waiting import soak, until
from bench.errors import StepError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Fresh, Invalid, Stale, Valid, Window
from bench.report.status_text import status_lines
from bench.rig import Rig
from bench.runner.commands import _latest_to_json
from bench.sequence.steps.measuring import Measure
from bench.sequence.steps.waits import Soak, WaitUntil
from bench.store.reader import RunReader
from bench.store.writer import RunWriter
from drivers.capabilities import Meter
from drivers.values import Reading
from tests.support.runs import copy_bench
from tests.unit.engine.test_interlocks import FAST, HOT, SILENT, made

ROOT = Path(__file__).parents[3]
BENCH = load_bench(ROOT / "config/simulated.yaml").bench
BEGINS_S = 10.0  # of what goes wrong
NAMED, UNNAMED = "unit_temperature", "counter.Temperatures.Converter"
Course = Callable[[float], Reading | None]

# What a sensor at 20 °C does from then on: every number of it would decide something if it were taken for valid.
WRONG: dict[str, tuple[Course, str]] = {
    "not a number": (lambda at_s: Reading(at_s, math.nan), "not-a-number"),
    "infinite": (lambda at_s: Reading(at_s, math.inf), "not-a-number"),
    "minus infinite": (lambda at_s: Reading(at_s, -math.inf), "not-a-number"),
    "above anything": (lambda at_s: Reading(at_s, 320.0), "outside the possible range"),
    "below anything": (lambda at_s: Reading(at_s, -200.0), "outside the possible range"),
    "a step up": (lambda at_s: Reading(at_s, 150.0), "faster than it can change"),
    "a step down": (lambda at_s: Reading(at_s, -90.0), "faster than it can change"),
    "hot with one time stamp": (lambda _: Reading(BEGINS_S - 1, 150.0), "time stamp of the reading before it"),
    "cold with one time stamp": (lambda _: Reading(BEGINS_S - 1, -90.0), "time stamp of the reading before it"),
    "the same again": (lambda _: Reading(BEGINS_S - 1, 20.01), "time stamp of the reading before it"),
    "from the past": (lambda at_s: Reading(at_s - 1000, 20.0), "before that of the reading before it"),
    "from the future": (lambda at_s: Reading(at_s + 1000, 20.0), "in the future"),
    "at no time": (lambda _: Reading(math.nan, 20.0), "in the future"),
    "silent": (lambda _: None, "no valid reading"),
}  # fmt: skip


class Sensor:
    """A device that is read once a second: 20 °C with a little noise, and from `begins_s` on a course of its own."""

    def __init__(self, channel: str, course: Course, begins_s: float = BEGINS_S) -> None:
        self._channel, self._course, self._begins_s = channel, course, begins_s

    async def poll(self) -> Mapping[str, list[Reading]]:
        """The reading of now."""
        at_s = asyncio.get_running_loop().time()
        reading = Reading(at_s, 20.0 + at_s % 2 / 100) if at_s < self._begins_s else self._course(at_s)
        return {self._channel: [reading] if reading is not None else []}


def ended(folder: Path, name: str, course: Course, step: Callable[[Monitor], Awaitable[Any]], after_s: float = 0.0):
    """What a step finds that begins after a time, or the problem by which it ends; and the values that are stored."""
    source = BENCH.readings[name].from_ if name in BENCH.readings else name
    writer = RunWriter(folder)

    async def main() -> Any:
        device = Sensor(source.partition(".")[2], course)
        monitor = Monitor(
            Rig(cast("Any", {"counter": device})), BENCH, Interlocks({}, BENCH), Journal(writer), lambda *_: None
        )
        monitor.start()
        await asyncio.sleep(after_s)
        acting = asyncio.ensure_future(step(monitor))
        await asyncio.wait([acting, monitor.fault], return_when=asyncio.FIRST_COMPLETED)
        found = monitor.fault.result() if monitor.fault.done() else acting.exception() or acting.result()
        acting.cancel()
        await monitor.stop()
        return found

    try:
        found = run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()
    with RunReader(folder) as reader:
        return found, reader.series(name).values.tolist()


STEPS = {
    "above": {"wait_until": "", "above": "100 °C", "give_up_after": "2 min"},
    "below": {"wait_until": "", "below": "-50 °C", "give_up_after": "2 min"},
    "between, held": {"wait_until": "", "above": "0 °C", "below": "40 °C", "hold": "30 s", "give_up_after": "2 min"},
    "stable": {
        "soak": "", "at_least": "0 s", "give_up_after": "2 min",
        "until_stable": {"band": "1 °C", "slope": "60 °C/h", "hold": "30 s"},
    },
    "stable, late": {
        "soak": "", "at_least": "32 s", "give_up_after": "2 min",
        "until_stable": {"band": "1 °C", "slope": "60 °C/h", "hold": "5 s"},
    },
    "measured": {"measure": "", "for": "30 s", "as": "it"},
    "measured, late": {"measure": "", "as": "it"},
}  # fmt: skip
BEGIN_S = {"measured, late": BEGINS_S + 5}


def acting(kind: str, name: str) -> Callable[[Monitor], Awaitable[Any]]:
    """The step of a kind on a reading."""
    written = {key: name if value == "" else value for key, value in STEPS[kind].items()}
    if "wait_until" in written:
        return lambda monitor: until(WaitUntil.model_validate(written), monitor)
    if "soak" in written:
        return lambda monitor: soak(Soak.model_validate(written), monitor)
    step = Measure.model_validate(written)
    return lambda monitor: measure(step, "it", cast("Bench", _JustMonitored(monitor)))


class _JustMonitored:
    def __init__(self, monitor: Monitor) -> None:
        self.file, self.monitor = BENCH, monitor


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, name) for kind in STEPS for name in (NAMED, UNNAMED) if name == NAMED or "stable" not in kind],
)
@pytest.mark.parametrize("wrong", WRONG)
def test_no_step_decides_on_what_is_wrong_and_the_end_names_it(tmp_path, wrong, kind, name) -> None:
    course, cause = WRONG[wrong]
    found, stored = ended(tmp_path, name, course, acting(kind, name), BEGIN_S.get(kind, 0.0))
    assert isinstance(found, Exception), f"decided: {found}"
    assert name in str(found)
    assert cause in str(found)
    assert stored == [20.0 + number % 2 / 100 for number in range(10)]


@pytest.mark.parametrize("kind", ["between, held", "stable", "measured"])
def test_a_reading_that_is_good_decides(tmp_path, kind) -> None:
    """The same steps on a sensor with nothing wrong, so that the test above shows something."""
    found, _ = ended(tmp_path, NAMED, lambda at_s: Reading(at_s, 20.0 + at_s % 2 / 100), acting(kind, NAMED))
    assert not isinstance(found, Exception)


def test_what_was_stable_before_the_step_does_not_end_a_soak(tmp_path) -> None:
    def good(at_s: float) -> Reading:
        return Reading(at_s, 20.0 + at_s % 2 / 100)

    found, _ = ended(tmp_path, NAMED, good, acting("stable", NAMED), after_s=100.0)
    assert 0.95 * 30 <= found["soaked_s"] <= 35


def test_a_gap_within_the_time_that_is_judged_is_no_hold(tmp_path) -> None:
    def gap(at_s: float) -> Reading | None:
        return Reading(at_s, 20.0) if at_s > 25 else None

    found, _ = ended(tmp_path, UNNAMED, gap, acting("between, held", UNNAMED))
    assert not isinstance(found, Exception)
    assert found["waited_s"] >= 25 + 0.95 * 30


# Interlocks


def test_what_has_tripped_recovers_by_valid_readings_without_a_gap_only() -> None:
    watch = made(hot={**HOT, "for": "0 s"})
    source = "counter.Temperatures.Unit"

    def judged(at_s: float, value: float) -> list[bool]:
        watch.take(source, [Valid(at_s, value, 1)])
        return [change.tripped for change in watch.evaluate(at_s)]

    assert judged(0, 90.0) == [True]
    assert judged(1, 80.0) == []
    assert judged(101, 80.0) == [], "of the 100 s in between nothing is known"
    assert [judged(at_s, 80.0) for at_s in (102, 103, 104)] == [[], [], [False]]


def test_a_rate_over_a_gap_trips_but_does_not_recover() -> None:
    watch = made(fast={**FAST, "good_for": "0 s"})
    source = "counter.Temperatures.Unit"

    def judged(at_s: float, value: float) -> list[bool]:
        watch.take(source, [Valid(at_s, value, 1)])
        return [change.tripped for change in watch.evaluate(at_s)]

    assert [found for at_s in range(0, 125, 4) if (found := judged(at_s, at_s / 5))] == [[True]]
    assert judged(1000, 24.2) == [], "the mean rate since 124 s is small, and over a gap"
    assert [at_s for at_s in range(1004, 1200, 4) if judged(at_s, 24.2)] == [1120]
    assert judged(2000, 200.0) == [True]


@pytest.mark.parametrize("cause", ["invalid", "stale"])
def test_a_difference_to_what_is_not_known_is_not_judged(cause) -> None:
    air, set_point = "chamber.process_value", "chamber.set_point"
    for first_c, then_c, now_tripped in ((20.0, 90.0, []), (90.0, 20.0, [True])):
        watch = made(astray={"difference": [air, set_point], "above": "5 °C", "then": "pause"})
        watch.take(air, [Valid(0, first_c, 1)])
        watch.take(set_point, [Valid(0, 20.0, 1)])
        assert [change.tripped for change in watch.evaluate(0)] == now_tripped
        if cause == "invalid":
            watch.invalidate(set_point)
        at_s = 1.0 if cause == "invalid" else 1000.0
        watch.take(air, [Valid(at_s, then_c, 2)])
        assert watch.evaluate(at_s) == ()
        watch.take(set_point, [Valid(at_s + 1, 20.0, 2)])
        assert [change.tripped for change in watch.evaluate(at_s + 1)] == [not now_tripped]


@pytest.mark.parametrize("wrong", WRONG)
def test_an_age_is_that_of_the_newest_valid_reading(tmp_path, wrong) -> None:
    reported = interlocked(tmp_path, {"silent": SILENT}, WRONG[wrong][0], UNNAMED)
    assert reported == [(40.0, "silent", True)]


@pytest.mark.parametrize("wrong", WRONG)
def test_no_interlock_trips_on_what_is_wrong(tmp_path, wrong) -> None:
    entries = {
        "hot": {"reading": UNNAMED, "above": "21 °C", "below": "19 °C", "then": "abort"},
        "fast": {"rate_of": UNNAMED, "over": "5 s", "above": "5 °C/min", "then": "abort"},
    }
    assert interlocked(tmp_path, entries, WRONG[wrong][0], UNNAMED) == []


def interlocked(folder: Path, entries: Mapping[str, Any], course: Course, name: str) -> list[tuple[float, str, bool]]:
    """Which interlocks change, and when, while a sensor does as its course."""
    reported: list[tuple[float, str, bool]] = []
    entries = {key: {k: name if v == NAMED else v for k, v in entry.items()} for key, entry in entries.items()}
    writer = RunWriter(folder)

    async def main() -> None:
        device = Sensor(name.partition(".")[2], course)
        monitor = Monitor(
            Rig(cast("Any", {"counter": device})), BENCH, made(**entries), Journal(writer), lambda *_: None
        )
        loop = asyncio.get_running_loop()
        monitor.on_interlock = lambda change: reported.append((loop.time(), change.name, change.tripped))
        monitor.start()
        await asyncio.sleep(60.5)
        await monitor.stop()
        assert not monitor.fault.done() or str(monitor.fault.result()).startswith(f"{name} ")  # nothing but the sensor

    try:
        run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()
    return reported


# The window of a supply


@pytest.mark.parametrize("wrong", [name for name in WRONG if name not in ("a step up", "a step down")])
def test_a_current_that_is_not_known_is_a_fault_while_the_output_is_on(tmp_path, wrong) -> None:
    course, cause = WRONG[wrong]
    if wrong in ("above anything", "below anything"):  # a current has no such bounds: it leaves its window
        cause = "the units draw"
    elif "time stamp of" in cause:  # it is before others here
        cause = "no valid reading"
    writer = RunWriter(tmp_path)

    async def main() -> Exception:
        monitor = Monitor(
            Rig(cast("Any", {"supply": Sensor("current", course, 60.0)})), BENCH, Interlocks({}, BENCH),
            Journal(writer), lambda *_: None,
        )  # fmt: skip
        allowed = monitor.windows["supply"]
        allowed.low, allowed.high, allowed.on_since_s = 19.0, 21.0, 0.0
        monitor.start()
        return await asyncio.wait_for(monitor.fault, 200.0)

    try:
        found = run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()
    assert "supply" in str(found)
    assert cause in str(found)


# A meter in an acquisition


@pytest.mark.parametrize("wrong", ["not a number", "infinite", "the same again", "from the past", "from the future"])
def test_a_meter_gives_no_invalid_reading_to_a_result(wrong) -> None:
    course, cause = WRONG[wrong]
    kept: list[Valid] = []

    class Voltmeter(Meter):
        name = "dvm"

        async def measure(self, count: int, *, nplc: float | None) -> list[Reading]:
            await asyncio.sleep(1.0)
            at_s = asyncio.get_running_loop().time()
            reading = Reading(at_s, 1.5) if at_s < BEGINS_S else course(at_s)
            return [reading] * count if reading is not None else []

    class Keeping:
        def frames(self, role, block) -> None:
            """None come."""

        def readings(self, role, readings) -> None:
            kept.extend(readings)

    meter = Voltmeter()
    rig = SimpleNamespace(devices={"dvm": meter}, meter=lambda _: meter)

    async def main() -> None:
        await acquire_into(["dvm"], cast("Rig", rig), [cast("Any", Keeping())], asyncio.sleep(60))

    with pytest.raises(StepError, match=f"dvm was read .*{cause}"):
        run(main(), AS_FAST_AS_POSSIBLE)
    assert [reading.value for reading in kept] == [1.5] * 9


# A channel


def age(now_s: float) -> Callable[[float], float]:
    return lambda at_s: now_s - at_s


def test_the_latest_value_is_fresh_invalid_or_stale() -> None:
    by = Channel("it", "V", Rule(stale_after_s=5.0))
    assert by.latest(age(0.0)) == Stale("has not been read yet", math.inf)
    by.take([Reading(1.0, 2.0)], 1.0)
    assert by.latest(age(4.0)) == Fresh(Valid(1.0, 2.0, 1), 3.0)
    assert isinstance(by.latest(age(6.1)), Stale)
    by.take([Reading(2.0, math.nan)], 2.0)
    assert by.latest(age(4.0)) == Invalid(2.0, "was read as not-a-number", 2, "nan")
    assert by.latest(age(7.0)) == Stale(
        "has had no valid reading for 6 s: the newest one was read as not-a-number", 6.0
    )
    by.take([Reading(8.0, 2.5)], 8.0)
    assert by.latest(age(8.0)) == Fresh(Valid(8.0, 2.5, 3), 0.0)


def test_what_piled_up_under_one_time_stamp_is_no_fault_of_the_sensor() -> None:
    by = Channel("it", "V", Rule())
    valid, invalid = by.take([Reading(1.0, 2.0)] * 5, 1.0)
    assert ([each.number for each in valid], [each.number for each in invalid]) == ([1], [2, 3])
    assert by.problem == ""


def test_what_an_instrument_stamps_a_little_ahead_is_taken() -> None:
    by = Channel("it", "V", Rule())
    assert len(by.take([Reading(1.4, 2.0)], 1.0)[0]) == 1
    assert len(by.take([Reading(2.6, 2.0)], 2.0)[1]) == 1


@pytest.mark.parametrize("begin_s", [0.0, 95.0, 100.1])
def test_a_window_has_nothing_from_before(begin_s) -> None:
    by = Channel("it", "V", Rule(stale_after_s=5.0))
    by.take([Reading(float(at_s), 1.0) for at_s in range(101)], 100.0)
    found = by.window(10.0, begin_s, age(102.0))
    if begin_s > 100:
        assert isinstance(found, Stale)
    else:
        assert isinstance(found, Window)
        assert found.at_s.tolist() == [float(at_s) for at_s in range(max(90, int(begin_s)), 101)]


def test_status_shows_no_number_of_what_is_invalid_or_stale() -> None:
    shown = {
        name: _latest_to_json(latest, "°C")
        for name, latest in (
            ("TC1", Invalid(2.0, "was read as not-a-number", 2, "nan")),
            ("TC2", Stale("has had no valid reading for 6 s", 6.0)),
            ("TC3", Fresh(Valid(8.0, 20.5, 3), 0.5)),
        )
    }
    status: dict[str, Any] = {"state": "running", "now_s": 9.0, "held_by": [], "under_way": [], "done": 1}
    status |= {"variables": {}, "limits_failed": [], "left_out": [], "dropped": {}, "lost": {}, "problems": []}

    class Summary:
        id, units = "it", ()

    lines = [" ".join(line.split()) for line in status_lines(cast("Any", Summary()), status | {"readings": shown})]
    assert lines[-3:] == [
        "TC1 invalid was read as not-a-number",
        "TC2 stale has had no valid reading for 6 s",
        "TC3 20.5 °C 1 s ago",
    ]


# Types


def test_only_a_channel_makes_what_decisions_are_taken_on() -> None:
    makers = {
        (path.relative_to(ROOT).as_posix(), called)
        for folder in ("bench", "drivers")
        for path in (ROOT / folder).rglob("*.py")
        if "bench.quality" in (text := path.read_text("utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        and (called := getattr(node.func, "id", getattr(node.func, "attr", ""))) in ("Valid", "Fresh", "Window")
    }
    assert makers == {("bench/engine/channel.py", called) for called in ("Valid", "Fresh", "Window")}


MISUSE = """\
from bench.engine.interlocks import Interlocks
from bench.engine.monitor import Monitor
from bench.quality import Invalid, Latest, Stale
from bench.store.writer import RunWriter
from drivers.capabilities import Meter
from drivers.values import Reading


def misuse(raw: Reading, bad: Invalid, late: Stale, latest: Latest, to: Interlocks, by: RunWriter, of: Monitor) -> None:
    to.take("it", [raw])
    to.take("it", [bad])
    by.readings("it", "V", [raw])
    by.samples("it", "a", [bad])
    print(latest.value > 3)
    print(latest.reading.value > 3)
    print(bad.value, late.value)
    print(bad > 3.0, late < 3.0)
    print(of.latest("it") > 3.0)
    print(of.window("it", 1.0, 0.0).values)
"""


@pytest.mark.slow
def test_mypy_finds_every_use_of_what_is_not_known_to_be_valid(tmp_path) -> None:
    from mypy import api

    (tmp_path / "misuse.py").write_text(MISUSE)
    options = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(tmp_path / "cache")]
    found, message, _ = api.run([*options, str(tmp_path / "misuse.py")])
    wrong = {int(line.split(":")[1]) for line in found.splitlines() if ": error: " in line and "misuse.py" in line}
    assert wrong == set(range(10, 20)), found + message


def test_the_age_of_a_named_reading_is_that_of_the_bench_file(tmp_path) -> None:
    from bench.config.channels import channels_of

    bench = load_bench(copy_bench(tmp_path, ("stale_after: 5 s", "stale_after: 7 s"))).bench
    channels = channels_of(bench)
    late_s = bench.devices["counter"].description.reports_every_s
    assert channels[NAMED].stale_after_s == channels["counter.Temperatures.Unit"].stale_after_s == 7.0 + late_s
    assert channels["chamber.process_value"].stale_after_s == 4 * bench.monitor.devices
