"""Interlocks fed by hand, and by a monitor in virtual time: what trips, when, what is said, and what is good again."""

from __future__ import annotations

import asyncio
import math
from itertools import groupby, pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from bench.config.bench import load_bench
from bench.config.interlocks import InterlockEntry
from bench.engine.interlocks import Interlocks
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Valid
from bench.rig import Rig
from bench.store.reader import RunReader
from bench.store.writer import RunWriter
from drivers.values import Reading

BENCH = load_bench(Path(__file__).parents[3] / "config/simulated.yaml").bench
UNIT, AIR, SET_POINT = "counter.Temperatures.Unit", "chamber.process_value", "chamber.set_point"
ENTRY = TypeAdapter(InterlockEntry)

HOT = {"reading": "unit_temperature", "above": "85 °C", "for": "5 s", "then": "pause", "good_for": "3 s"}
FAST = {"rate_of": "unit_temperature", "over": "2 min", "above": "5 °C/min", "then": "hold"}
ASTRAY = {"difference": ["chamber.process_value", "chamber.set_point"], "above": "5 °C", "for": "10 s", "then": "pause"}
SILENT = {"age_of": "unit_temperature", "above": "30 s", "then": "hold"}
SUPPLY = {"reading": "supply.voltage", "above": "15 V", "below": "14 V", "then": "abort"}


def made(**entries) -> Interlocks:
    return Interlocks({name: ENTRY.validate_python(entry) for name, entry in entries.items()}, BENCH)


def changes(interlocks, readings, source=UNIT):
    """When each interlock trips (True) and is good again (False), by the times of the readings."""
    found = []
    for at_s, value in readings:
        interlocks.take(source, [Valid(at_s, value, 1)])
        found += [(at_s, change.name, change.tripped) for change in interlocks.evaluate(at_s)]
    return found


def texts(interlocks, readings, source=UNIT):
    interlocks.take(source, [Valid(*reading, 1) for reading in readings])
    return [change.text for change in interlocks.evaluate(readings[-1][0])]


def test_who_is_judged_by_age_is_asked_also_while_he_says_nothing():
    assert made(silent=SILENT, hot=HOT).judge_age_of("counter")
    assert not made(silent=SILENT).judge_age_of("chamber")
    assert not made(hot=HOT, fast=FAST).judge_age_of("counter")


# A reading


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ("ghhhhhh", [(6, True)]),  # hot from 1 s on
        ("ghhhhhg", []),
        ("ghhhhghhhhhh", [(11, True)]),  # one good reading begins the debounce anew
        ("hghghghghghghg", []),
        ("hhhhhhgggg", [(5, True), (9, False)]),
        ("hhhhhhggghgggg", [(5, True), (13, False)]),  # flaps on its way back
        ("hhhhhhgggghhhhhhh", [(5, True), (9, False), (15, True)]),
        ("hhhhhhhhhhhhhhh", [(5, True)]),  # told once
        ("hhhhnh", [(5, True)]),  # what is not a number is not good
    ],
)
def test_it_trips_after_its_debounce_and_goes_on_when_it_has_been_good_for_long_enough(values, found):
    value_of = {"g": 85.0, "h": 85.1, "n": math.nan}
    readings = [(at_s, value_of[letter]) for at_s, letter in enumerate(values)]
    assert [(at_s, tripped) for at_s, _, tripped in changes(made(hot=HOT), readings)] == found


def test_without_times_the_first_bad_reading_trips_and_the_first_good_one_lets_go():
    watch = made(hot={"reading": UNIT, "above": "85 °C", "then": "pause"})
    assert changes(watch, [(0, 84), (1, 86), (2, 84), (3, 86)]) == [
        (1, "hot", True), (2, "hot", False), (3, "hot", True)
    ]  # fmt: skip


@pytest.mark.parametrize("action", ["stop", "abort"])
def test_a_stop_and_an_abort_are_for_good(action):
    watch = made(hot={"reading": UNIT, "above": "85 °C", "then": action})
    assert changes(watch, [(0, 86), (1, 20), (1e6, 20), (1e6 + 1, 86)]) == [(0, "hot", True)]


def test_both_limits_are_watched_and_both_belong_to_what_is_good():
    readings = [(0, 14.0), (1, 15.0), (2, 15.01), (3, 14.5), (4, 13.99)]
    watch = made(supply={**SUPPLY, "then": "pause"})
    assert [at_s for at_s, _, tripped in changes(watch, readings, "supply.voltage") if tripped] == [2, 4]


def test_a_limit_may_be_below_alone():
    watch = made(cold={"reading": UNIT, "below": "-40 °C", "then": "stop"})
    assert changes(watch, [(0, 90), (1, -40), (2, -41)]) == [(2, "cold", True)]


def test_time_alone_trips_nothing_and_lets_nothing_go():
    watch = made(hot=HOT)
    assert changes(watch, [(0, 86)]) == []
    assert watch.evaluate(1000.0) == (), "one reading does not show that it was hot all the time"
    assert changes(watch, [(5, 86)]) == [(5, "hot", True)]
    assert changes(watch, [(6, 80)]) == []
    assert watch.evaluate(1000.0) == ()


def test_readings_that_come_together_are_judged_at_their_own_times():
    watch = made(hot=HOT)
    watch.take(UNIT, [Valid(at_s, 86 if 1 <= at_s <= 6 else 80, 1) for at_s in range(11)])
    assert [(change.tripped, change.since_s) for change in watch.evaluate(11.0)] == [(True, 1), (False, 7)]
    assert watch.evaluate(11.0) == ()


def test_a_reading_is_the_same_by_its_name_and_by_its_channel():
    watch = made(named=HOT, by_channel={**HOT, "reading": UNIT})
    hot = [(at_s, 86.0) for at_s in range(6)]
    assert changes(watch, hot) == [(5, "named", True), (5, "by_channel", True)]


def test_two_at_once_are_told_each_by_itself():
    watch = made(hot=HOT, warm={"reading": UNIT, "above": "30 °C", "then": "hold"}, supply=SUPPLY)
    readings = [(at_s, 86.0) for at_s in range(6)] + [(6, 50.0), (7, 20.0), (8, 20.0), (9, 20.0)]
    assert changes(watch, readings) == [
        (0, "warm", True), (5, "hot", True), (7, "warm", False), (9, "hot", False)
    ]  # fmt: skip


@st.composite
def courses(draw):
    """Readings that are often good and often bad, in times that rise."""
    gaps = draw(st.lists(st.integers(1, 8), min_size=1, max_size=40))
    bad = draw(st.lists(st.booleans(), min_size=len(gaps), max_size=len(gaps)))
    return [(sum(gaps[: index + 1]), 90.0 if bad[index] else 80.0) for index in range(len(gaps))]


def as_defined(course, for_s, good_for_s):
    """What must be found, by looking back from every reading over all that are alike."""
    found, tripped = [], False
    for _, alike in groupby(course, key=lambda reading: reading[1] > 85):
        alike = list(alike)
        is_bad = alike[0][1] > 85
        long_enough = [at_s for at_s, _ in alike if at_s - alike[0][0] >= (for_s if is_bad else good_for_s)]
        if is_bad != tripped and long_enough:
            tripped = is_bad
            found.append((long_enough[0], "x", tripped))
    return found


@given(course=courses(), for_s=st.integers(0, 20), good_for_s=st.integers(0, 20))
def test_it_trips_if_and_only_if_the_condition_held_for_the_whole_debounce(course, for_s, good_for_s):
    entry = {"reading": UNIT, "above": "85 °C", "then": "pause", "for": f"{for_s} s", "good_for": f"{good_for_s} s"}
    assert changes(made(x=entry), course) == as_defined(course, for_s, good_for_s)


@given(course=courses(), cuts=st.lists(st.integers(0, 40), max_size=5))
def test_it_makes_no_difference_in_which_portions_readings_come(course, cuts):
    one, other = made(hot=HOT, fast=FAST), made(hot=HOT, fast=FAST)
    for begin, end in pairwise([0, *sorted(min(cut, len(course)) for cut in cuts), len(course)]):
        one.take(UNIT, [Valid(*reading, 1) for reading in course[begin:end]])
    for reading in course:
        other.take(UNIT, [Valid(*reading, 1)])
    reported, expected = (sorted(watch.evaluate(1e6), key=str) for watch in (one, other))
    assert reported == expected


# A rate


def ramp(rate_c_per_min, begin_s=0, end_s=600, start_c=20.0):
    return [(at_s, start_c + rate_c_per_min * (at_s - begin_s) / 60) for at_s in range(begin_s, end_s)]


@pytest.mark.parametrize(
    ("rate_c_per_min", "found"),
    [(4.99, []), (5.01, [(120, "fast", True)]), (-4.99, []), (-5.01, [(120, "fast", True)])],
)
def test_a_rate_is_judged_whatever_its_direction_once_there_are_readings_enough(rate_c_per_min, found):
    assert changes(made(fast=FAST), ramp(rate_c_per_min)) == found


def test_a_rate_is_the_mean_over_its_time_so_that_a_short_step_is_no_rate():
    step = [(at_s, 20.0 if at_s < 300 else 29.0) for at_s in range(600)]
    assert changes(made(fast=FAST), step) == [], "9 °C in 2 min are 4.5 °C/min"
    higher = [(at_s, 20.0 if at_s < 300 else 31.0) for at_s in range(600)]
    assert changes(made(fast=FAST), higher) == [(300, "fast", True), (420, "fast", False)]


def test_a_rate_over_a_gap_is_the_mean_over_the_gap():
    readings = [(0, 20.0), (60, 20.0), (660, 75.0), (661, 75.1)]
    assert changes(made(fast=FAST), readings) == [(660, "fast", True)]
    assert changes(made(fast=FAST), [(0, 20.0), (60, 20.0), (660, 65.0)]) == []


def test_a_rate_is_in_the_unit_of_its_reading_over_time():
    entry = {"rate_of": "head.angle", "over": "10 s", "above": "6 rpm", "then": "stop"}
    turning = [(at_s, 35.0 * at_s) for at_s in range(20)]
    assert changes(made(x=entry), turning, "head.angle") == []
    watch = made(x={**entry, "above": "0.5 rpm"})
    watch.take("head.angle", [Valid(*reading, 1) for reading in turning])
    (change,) = watch.evaluate(20.0)
    assert "head.angle changes by 35 °/s, allowed is ±3 °/s" in change.text


# A difference


def both(watch, at_s, air_c, set_point_c):
    watch.take(AIR, [Valid(at_s, air_c, 1)])
    watch.take(SET_POINT, [Valid(at_s, set_point_c, 1)])
    return [(at_s, change.tripped) for change in watch.evaluate(at_s)]


@pytest.mark.parametrize(("bad_c", "good_c"), [(25.1, 25.0), (14.9, 15.0)])
def test_a_difference_is_judged_whatever_its_sign(bad_c, good_c):
    watch = made(astray=ASTRAY)
    found = [both(watch, at_s, bad_c if at_s < 30 else good_c, 20.0) for at_s in range(0, 50, 10)]
    assert found == [[], [(10, True)], [], [(30, False)], []]


def test_a_difference_is_judged_when_both_have_come_not_between():
    watch = made(astray={**ASTRAY, "for": "0 s"})
    assert both(watch, 0, 20.0, 20.0) == []
    assert both(watch, 1, 60.0, 60.0) == [], "both have stepped together"


def test_a_difference_waits_for_both_and_then_for_either():
    watch = made(astray=ASTRAY)
    watch.take(AIR, [Valid(0, 90.0, 1)])
    assert watch.evaluate(0.0) == ()
    watch.take(SET_POINT, [Valid(5, 20.0, 1)])
    assert watch.evaluate(5.0) == ()
    assert watch.evaluate(100.0) == (), "nothing new"
    watch.take(AIR, [Valid(15, 90.0, 1)])
    assert [change.since_s for change in watch.evaluate(15.0)] == [5]


def test_a_difference_may_wait_until_the_second_is_at_rest():
    watch = made(astray={**ASTRAY, "for": "0 s", "once_at_rest_for": "60 s"})
    air_c = [20.0, *[40.0] * 9, 42.4, *[42.6] * 20]  # more than half of 5 °C from 40 °C begins a new rest
    found = [bool(both(watch, 10 * number, value, 20.0)) for number, value in enumerate(air_c)]
    assert found.index(True) == 6, "60 s after the second was first seen; the first may do what it likes"
    watch = made(astray={**ASTRAY, "for": "0 s", "once_at_rest_for": "60 s"})
    found = [bool(both(watch, 10 * number, 20.0, value)) for number, value in enumerate(air_c)]
    assert found.index(True) == 7, "60 s after it came to 40 °C"
    watch = made(astray={**ASTRAY, "for": "0 s", "once_at_rest_for": "100 s"})
    found = [bool(both(watch, 10 * number, 20.0, value)) for number, value in enumerate(air_c)]
    assert found.index(True) == 21, "100 s after it came to 42.6 °C"


# An age


def test_an_age_trips_by_time_alone_and_is_good_with_the_next_reading():
    watch = made(silent=SILENT)
    watch.take(UNIT, [Valid(100.0, 20.0, 1)])
    assert [bool(watch.evaluate(now_s)) for now_s in (100.0, 130.0, 130.5, 131.0)] == [False, False, True, False]
    watch.take(UNIT, [Valid(131.0, 20.0, 1)])
    (change,) = watch.evaluate(131.5)
    assert (change.tripped, change.since_s) == (False, 131.5)


def test_a_reading_that_never_came_is_as_old_as_the_watching():
    watch = made(silent={**SILENT, "for": "10 s"})
    found = [(now_s, change.since_s) for now_s in range(1000, 1060) for change in watch.evaluate(now_s)]
    assert found == [(1041, 1031)]


def test_a_reading_that_comes_late_is_as_old_as_it_is():
    watch = made(silent=SILENT)
    watch.evaluate(0.0)
    watch.take(UNIT, [Valid(2.0, 20.0, 1)])
    assert [change.tripped for change in watch.evaluate(33.0)] == [True]


# What is said


@pytest.mark.parametrize(
    ("entry", "readings", "source", "message"),
    [
        (
            {**HOT, "then": "stop", "good_for": None}, [(0, 85.5), (6, 86.25)], UNIT,
            "Interlock x has tripped after 6 s: unit_temperature is 86.25 °C, allowed is at most 85 °C. "
            "The step under way ends, and the teardown runs. "
            "Check unit_temperature: the sensors, and what they measure.",
        ),
        (
            SUPPLY, [(0, 0.0)], "supply.voltage",
            "Interlock x has tripped: supply.voltage is 0 V, allowed is 14 to 15 V. "
            "Everything is made safe now, without the teardown. "
            "Check supply.voltage: the sensors, and what they measure.",
        ),
        (
            {"reading": UNIT, "below": "-40 °C", "then": "pause"}, [(0, -50.0)], UNIT,
            "Interlock x has tripped: counter.Temperatures.Unit is -50 °C, allowed is at least -40 °C. "
            "No further step begins until it is good. "
            "Check counter.Temperatures.Unit: the sensors, and what they measure.",
        ),
        (
            {**FAST, "good_for": "90 s"}, [(0, 20.0), (120, 8.0)], UNIT,
            "Interlock x has tripped: unit_temperature changes by -6 °C/min, allowed is ±5 °C/min. "
            "The chamber holds its set point where it is, and no further step begins until it has been in range for "
            "90 s. "
            "Check unit_temperature: the sensors, and what they measure.",
        ),
    ],
)  # fmt: skip
def test_it_is_told_what_was_found_what_is_allowed_what_happens_and_what_to_do(entry, readings, source, message):
    entry = {key: value for key, value in entry.items() if value is not None}
    assert texts(made(x=entry), readings, source) == [message]


def test_of_a_difference_both_readings_are_named():
    watch = made(astray={**ASTRAY, "for": "30 min", "good_for": "5 min"})
    both(watch, 0, 26.0, 20.0)
    watch.take(AIR, [Valid(1800, 26.5, 2)])
    watch.take(SET_POINT, [Valid(1800, 20.0, 2)])
    (change,) = watch.evaluate(1800.0)
    assert change.text == (
        "Interlock astray has tripped after 30 min: chamber.process_value and chamber.set_point differ by 6.5 °C, "
        "allowed is at most 5 °C. No further step begins until it has been in range for 5 min. "
        "Check chamber.process_value and chamber.set_point: the sensors, and what they measure."
    )


def test_of_an_age_the_device_is_named():
    watch = made(silent={**SILENT, "then": "abort"})
    watch.evaluate(0.0)
    (change,) = watch.evaluate(31.25)
    assert change.text == (
        "Interlock silent has tripped: unit_temperature has had no new value for 31.25 s, allowed is at most 30 s. "
        "Everything is made safe now, without the teardown. Check the sensor, counter, and its cable."
    )


def test_what_is_good_again_says_so():
    readings = [(0, 86.0), (5, 86.0), (6, 84.0), (9, 83.5)]
    assert texts(made(hot=HOT), readings)[1] == (
        "Interlock hot has recovered after 3 s: unit_temperature is 83.5 °C, allowed is at most 85 °C."
    )


# In a monitor


class Scripted:
    """A device that gives one thing at each poll, and in the end nothing."""

    def __init__(self, *polls):
        self._polls = list(polls)

    async def poll(self):
        return self._polls.pop(0) if self._polls else {}


def watched(folder, interlocks, duration_s, **devices):
    """What a monitor tells of its interlocks in so much virtual time, and the journal of it."""
    reported = []
    writer = RunWriter(folder)

    async def main():
        monitor = Monitor(Rig(devices), BENCH, interlocks, Journal(writer), lambda name, reading: None)
        monitor.on_interlock = lambda change: reported.append((asyncio.get_running_loop().time(), change))
        monitor.start()
        await asyncio.sleep(duration_s)
        await monitor.stop()
        assert not monitor.fault.done()

    try:
        run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()
    with RunReader(folder) as reader:
        return reported, [(event.at_s, event.data) for event in reader.events("interlock")]


def test_a_monitor_gives_its_readings_to_the_interlocks_and_tells_and_records_what_changes(tmp_path):
    polls = [{"Temperatures.Unit": [Reading(at_s, 86.0 if 1 <= at_s <= 7 else 84.0)]} for at_s in range(12)]
    reported, journal = watched(tmp_path, made(hot=HOT), 11.5, counter=Scripted(*polls))
    assert [(at_s, change.tripped) for at_s, change in reported] == [(6.0, True), (11.0, False)]
    (tripped_s, tripped), (_, good) = journal
    assert (tripped_s, tripped["name"], tripped["action"], tripped["since_s"]) == (6.0, "hot", "pause", 1)
    assert tripped["text"] == reported[0][1].text
    assert (tripped["tripped"], good["tripped"]) == (True, False)


def test_no_interlock_trips_on_a_reading_that_is_not_believed(tmp_path):
    values = (20.0, 320.0, 20.0, math.nan, 20.0)
    polls = [{"Temperatures.Unit": [Reading(at_s, value)]} for at_s, value in enumerate(values)]
    hot = {"reading": "unit_temperature", "above": "85 °C", "then": "abort"}
    assert watched(tmp_path, made(hot=hot), 4.5, counter=Scripted(*polls)) == ([], [])


def test_a_monitor_looks_at_ages_while_no_reading_comes(tmp_path):
    reported, _ = watched(tmp_path, made(silent=SILENT), 40.0, counter=Scripted())
    assert [(at_s, change.name) for at_s, change in reported] == [(31.0, "silent")]


def test_the_poll_of_any_device_is_a_look(tmp_path):
    reported, _ = watched(tmp_path, made(silent=SILENT), 45.0, source=Scripted())
    assert [at_s for at_s, _ in reported] == [40.0], "the source is asked every 10 s"


def test_a_reading_grows_no_older_while_nobody_could_look() -> None:
    watch = made(silent=SILENT)
    watch.take(UNIT, [Valid(0.0, 20.0, 1)])
    assert watch.evaluate(1000.0, lambda since_s: 1000.0 - since_s) == ()
    assert [change.tripped for change in watch.evaluate(1000.0)] == [True]
