"""Interlocks in whole runs: what holds, pauses, stops and aborts them, and how they go on."""

from __future__ import annotations

import pytest

from bench.store.reader import RunReader
from tests.support.runs import copy_bench, run_short
from tests.support.sequences import TAIL, steps

OFF = "teardown:\n  - {set: supply, output: off}\n"
RAMP = "{ramp: chamber, to: 26 °C, at: 2 °C/min}"


def ran(tmp_path, interlocks, *lines, **options):
    path = tmp_path / "s.yaml"
    path.write_text(steps(*lines) + OFF + f"interlocks: {{{interlocks}}}\n" + TAIL, "utf-8")
    return run_short(tmp_path / "runs", sequence=str(path), **options)


def reported(result, *kinds):
    with RunReader(result.path) as reader:
        return [(event.kind, event.step, event.data) for event in reader.events(*kinds)]


def begun(result):
    return [step for _, step, _ in reported(result, "step_begins")]


def test_a_pause_holds_the_next_step_back_until_it_has_been_good_for_the_time(tmp_path):
    warm = "behind: {difference: [chamber.set_point, chamber.process_value], above: 1 °C, then: pause, good_for: 1 min}"
    result = ran(tmp_path, warm, RAMP, "wait: 1 s", "wait: 10 min")
    assert result.outcome.how == "completed"
    events = reported(result, "interlock", "held", "released", "step_begins")
    kinds = [kind for kind, _, _ in events]
    held = kinds.index("held")
    assert events[held][2] == {"by": "interlock behind"}
    released = kinds.index("released", held)
    assert "step_begins" not in kinds[held:released]
    assert "has recovered" in events[released - 1][2]["text"]


def test_a_hold_stops_the_chamber_where_it_is_and_the_ramp_is_done_again_afterwards(tmp_path):
    fast = "fast: {rate_of: chamber.process_value, over: 1 min, above: 1.5 °C/min, then: hold, good_for: 1 min}"
    bench = copy_bench(tmp_path / "config", ("period: 1 s", "period: 1 s\n  devices: 2 s"))
    result = ran(tmp_path, fast, RAMP, "wait: 1 s", bench=bench)
    assert result.outcome.how == "completed"
    assert begun(result)[:2] == ["steps/ramp", "steps/ramp~2"]
    assert ("step_cut", "steps/ramp", {"wish": "hold", "unknown": ["chamber"]}) in reported(result, "step_cut")
    with RunReader(result.path) as reader:
        set_point = reader.series("chamber.set_point")
        (good_s,) = [event.at_s for event in reader.events("interlock") if not event.data["tripped"]][:1]
        (tripped_s,) = [event.at_s for event in reader.events("interlock") if event.data["tripped"]][:1]
    while_held = set_point.values[(set_point.at_s > tripped_s + 15) & (set_point.at_s < good_s)]
    assert while_held.max() - while_held.min() < 0.01
    assert while_held.max() < 26


def test_a_stop_ends_the_step_and_the_teardown_runs(tmp_path):
    hot = "hot: {reading: unit_temperature, above: 21 °C, for: 10 s, then: stop}"
    result = ran(tmp_path, hot, RAMP, "wait: 1 h", "wait: 1 s")
    assert result.outcome.how == "error"
    assert "Interlock hot has tripped after" in result.problems[0]
    assert "allowed is at most 21 °C" in result.problems[0]
    assert begun(result)[-1] == "teardown/set"
    assert "steps/wait#2" not in begun(result)


def test_a_pause_that_does_not_get_good_again_stops_the_run(tmp_path):
    warm = "warm: {reading: unit_temperature, above: 10 °C, then: pause, give_up_after: 20 min}"
    result = ran(tmp_path, warm, "wait: 1 min", "wait: 1 s")
    assert result.outcome.how == "error"
    assert "It has not recovered within 20 min; the run is stopped." in result.problems[0]
    assert result.bench_s == pytest.approx(20 * 60, abs=30)
    assert begun(result)[-1] == "teardown/set"


def test_an_abort_makes_everything_safe_without_the_teardown(tmp_path):
    hot = "hot: {reading: unit_temperature, above: 21 °C, then: abort}"
    result = ran(tmp_path, hot, RAMP, "wait: 1 h")
    assert result.outcome.how == "error"
    assert "teardown/set" not in begun(result)
    assert reported(result, "made_safe") == [("made_safe", "", {"unsafe": {}})]


def test_an_interlock_of_the_bench_file_is_in_force_in_every_run(tmp_path):
    entry = "interlocks:\n  hot: {reading: unit_temperature, above: 21 °C, then: stop}\n"
    bench = copy_bench(tmp_path / "config", ("fixture:\n", f"{entry}fixture:\n"))
    result = ran(tmp_path, "", RAMP, "wait: 1 h", bench=bench)
    assert "Interlock hot has tripped" in result.problems[0]


@pytest.mark.parametrize("action", ["hold", "pause"])
def test_what_never_trips_changes_nothing(tmp_path, action):
    never = f"never: {{reading: unit_temperature, above: 90 °C, then: {action}}}"
    result = ran(tmp_path, never, "{ramp: chamber, to: 21 °C, at: 1 °C/min}")
    assert result.outcome.how == "completed"
    assert reported(result, "interlock", "held", "step_cut") == []


def test_what_fails_in_the_teardown_is_told_and_the_teardown_goes_on(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(
        steps("wait: 1 s") + "teardown:\n  - {wait: 2 min}\n  - {set: supply, output: off}\n" + TAIL, "utf-8"
    )
    fault = "[{after: steps/wait, at: 20 s, device: chamber, kind: silent, for: 30 s}]"
    bench = copy_bench(tmp_path / "config", faults=fault)
    result = run_short(tmp_path / "runs", sequence=str(path), bench=bench)
    assert begun(result)[-1] == "teardown/set"
    assert result.outcome.how == "error"
    assert result.problems[0].startswith("chamber: no answer")
