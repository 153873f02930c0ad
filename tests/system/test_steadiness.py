"""Waiting until what a unit puts out no longer drifts: by its output, not by a fixed time."""

import pytest

from bench.config.bench import load_bench
from bench.config.simulation import FaultSimulation
from tests.support.engines import run_plan
from tests.support.sequences import BENCH, ROOT, TAIL, plan_of, steps

ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
UP = "{move: head, to: 1°}"
OFF = "teardown:\n  - {set: supply, output: off}\n"
THREE = load_bench(ROOT / "config" / "three_units.yaml").bench


def waited(tmp_path, change, *, before=(ON, UP), give_up="3 h", bench=BENCH, needs=TAIL):
    step = f"{{wait_until: counter, steady: {{change: {change} pulse/s, over: 6 min}}, give_up_after: {give_up}}}"
    return run_plan(tmp_path / "run", plan_of(tmp_path, steps(*before, step) + OFF, tail=needs, bench=bench), bench)


def test_a_stricter_rule_waits_longer_after_power_on(tmp_path):
    """Self-heating and warm-up: 100 µg, which is 1.1 pulse/s, most of it within the first half hour."""
    took_s = {}
    for change in (0.3, 0.03):
        (tmp_path / f"{change}").mkdir()
        run = waited(tmp_path / f"{change}", change)
        assert run.outcome.how == "completed", run.outcome.problems
        found = run.ended("steps/wait_until").data
        assert abs(found["changes_pps"]["a"]) <= change
        took_s[change] = found["waited_s"]
    assert 360 <= took_s[0.3] < took_s[0.03] < 2 * 3600


def test_an_output_that_does_not_become_steady_ends_the_run_in_words(tmp_path):
    run = waited(tmp_path, 1e-6, give_up="10 min")
    assert run.outcome.how == "error"
    assert "The pulse rate of the unit in place a still changed by " in run.outcome.problems[0]
    assert "over 6 min, allowed are 1e-06 pulse/s" in run.outcome.problems[0]


def test_a_unit_that_is_dropped_meanwhile_is_not_waited_for(tmp_path):
    fault = FaultSimulation.model_validate({"unit": "b", "kind": "silent", "at": "20 s"})
    simulation = THREE.simulation.model_copy(update={"faults": (fault,)})
    bench = THREE.model_copy(update={"simulation": simulation})
    run = waited(tmp_path, 99, bench=bench, needs=TAIL.replace("  source: current_source\n", ""))
    assert run.outcome.how == "completed", run.outcome.problems
    assert set(run.ended("steps/wait_until").data["changes_pps"]) == {"a", "c"}


@pytest.mark.parametrize("name", ["counter", "counter.x"])
def test_a_counter_or_one_channel_of_it_may_be_named(tmp_path, name):
    step = f"{{wait_until: {name}, steady: {{change: 9 pulse/s, over: 30 s}}, give_up_after: 1 h}}"
    run = run_plan(tmp_path / "run", plan_of(tmp_path, steps(ON, UP, step) + OFF), BENCH)
    assert run.outcome.how == "completed", run.outcome.problems
    assert run.ended("steps/wait_until").data["waited_s"] == pytest.approx(30, abs=2)
