"""Chambers that break in whole runs: found within the time that the rules promise, said plainly, and all made safe."""

from __future__ import annotations

import pytest

from bench.store.reader import RunReader
from tests.support.runs import copy_bench, run_short
from tests.support.sequences import TAIL, steps

ON = "{set: supply, voltage: 15 V, current_limit: 150 mA, output: on}"
OFF = "teardown:\n  - {set: supply, output: off}\n"
BREAKS_S = 600.0


def ran(tmp_path, *lines, kind="", edits=(), faults=""):
    path = tmp_path / "s.yaml"
    path.write_text(steps(ON, *lines) + OFF + TAIL, "utf-8")
    if kind:
        faults = f"[{{device: chamber, kind: {kind}, at: {BREAKS_S:g} s}}]"
    bench = copy_bench(tmp_path / "config", *edits, faults=faults)
    return run_short(tmp_path / "runs", bench=bench, sequence=str(path))


@pytest.mark.parametrize(
    ("kind", "to_c", "within_s", "message"),
    [
        ("heater_dead", 35, 900, "the air has not come 1 °C closer to its set point within 10 min"),
        ("cooling_dead", 5, 900, "the air has not come 1 °C closer to its set point within 10 min"),
        ("runaway", 35, 240, "the air moves away from its set point"),
        ("detached_sensor", 35, 620, "the air has not come 1 °C closer to its set point within 10 min"),
        ("open_sensor", 35, 20, "the process value is far beyond the -50 to 100 °C of the bench"),
    ],
)
def test_a_chamber_that_breaks_in_a_soak_ends_the_run_safe_and_nothing_is_lost(tmp_path, kind, to_c, within_s, message):
    result = ran(tmp_path, f"{{ramp: chamber, to: {to_c} °C, at: 3 °C/min}}", "wait: 1 h", kind=kind)
    assert result.outcome.how == "error"
    assert f"chamber: {message}" in result.problems[0]
    assert "Look at the chamber itself: its heater" in result.problems[0]
    assert result.outcome.unsafe == {}
    with RunReader(result.path) as reader:
        ended = {event.step: event.data for event in reader.events("step_ended")}
        (problem,) = reader.events("problem")
        air = reader.series("chamber.process_value")
    assert problem.at_s - BREAKS_S <= within_s + 20
    assert ended["teardown/set"]["output"] is False
    assert air.at_s[-1] >= problem.at_s - 20, "recorded to the end"


def test_a_chamber_without_power_is_found_in_the_ramp(tmp_path):
    result = ran(tmp_path, "wait: 10 min", "{ramp: chamber, to: 40 °C, at: 1 °C/min}", "wait: 1 h", kind="slow")
    assert "the air has not come 1 °C closer" in result.problems[0]
    assert result.bench_s < 10 * 60 + 240 + 620


APART = """interlocks:
  apart: {difference: [unit_temperature, chamber.process_value], above: 10 °C, once_at_rest_for: 20 min, then: stop}
"""


def test_a_thermometer_that_lies_in_the_room_is_found_by_the_air_that_its_unit_should_follow(tmp_path):
    edits = [("fixture:\n", f"{APART}fixture:\n")]
    lines = ["{ramp: chamber, to: 36 °C, at: 3 °C/min}", "wait: 40 min"]
    result = ran(tmp_path, *lines, edits=edits, faults="[{unit: a, kind: detached_thermometer, at: 1 s}]")
    assert "Interlock apart has tripped: unit_temperature and chamber.process_value differ by 1" in result.problems[0]
    assert result.bench_s < 40 * 60


def test_a_chamber_in_order_at_its_limits_with_a_load_in_it_is_no_fault(tmp_path):
    up, down = (f"{{ramp: chamber, to: {to_c} °C, at: 3 °C/min}}" for to_c in (90, 20))
    slower = ("natural_period: 6 min, damping: 0.5", "natural_period: 20 min, damping: 0.4")
    edits = [slower, ("fixture:\n", f"{APART}fixture:\n")]
    result = ran(tmp_path, up, "wait: 30 min", down, edits=edits)
    assert result.outcome.how == "completed", result.problems
