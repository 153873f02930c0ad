"""Waiting until what a unit puts out no longer drifts: by its output, not by a fixed time."""

import pytest

from bench.config.bench import load_bench
from bench.config.places import Nominal
from bench.config.simulation import FaultSimulation
from tests.support.engines import run_plan
from tests.support.sequences import BENCH, ROOT, TAIL, plan_of, problems_of, steps

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
        assert abs(found["changes"]["a"]) <= change
        took_s[change] = found["waited_s"]
    assert 360 <= took_s[0.3] < took_s[0.03] < 2 * 3600


def test_an_output_that_does_not_become_steady_ends_the_run_in_words(tmp_path):
    run = waited(tmp_path, 1e-6, give_up="10 min")
    assert run.outcome.how == "error"
    assert "The output of the unit in place a still changed by " in run.outcome.problems[0]
    assert "over 6 min, allowed are 1e-06 pulse/s" in run.outcome.problems[0]


def test_a_unit_that_is_dropped_meanwhile_is_not_waited_for(tmp_path):
    fault = FaultSimulation.model_validate({"unit": "b", "kind": "silent", "at": "20 s"})
    simulation = THREE.simulation.model_copy(update={"faults": (fault,)})
    bench = THREE.model_copy(update={"simulation": simulation})
    run = waited(tmp_path, 99, bench=bench, needs=TAIL.replace("  source: current_source\n", ""))
    assert run.outcome.how == "completed", run.outcome.problems
    assert set(run.ended("steps/wait_until").data["changes"]) == {"a", "c"}


@pytest.mark.parametrize("name", ["counter", "counter.x"])
def test_a_counter_or_one_channel_of_it_may_be_named(tmp_path, name):
    step = f"{{wait_until: {name}, steady: {{change: 9 pulse/s, over: 30 s}}, give_up_after: 1 h}}"
    run = run_plan(tmp_path / "run", plan_of(tmp_path, steps(ON, UP, step) + OFF), BENCH)
    assert run.outcome.how == "completed", run.outcome.problems
    assert run.ended("steps/wait_until").data["waited_s"] == pytest.approx(30, abs=2)


# Outputs of every kind

TO_G = "{wait_until: output, steady: {change: 10 µg, over: 6 min}, give_up_after: 3 h}"
OUTPUT = TAIL.replace("  counter: pulse_counter\n  supply", "  output: output\n  supply").replace(
    "  source: current_source\n", ""
)


def bench_of(name):
    return load_bench(ROOT / "config" / f"{name}.yaml").bench


@pytest.mark.parametrize("name", ["simulated", "volts", "telemetry"])
def test_outputs_of_every_kind_become_steady_in_g(tmp_path, name):
    bench = bench_of(name)
    run = run_plan(tmp_path / "run", plan_of(tmp_path, steps(ON, UP, TO_G) + OFF, tail=OUTPUT, bench=bench), bench)
    assert run.outcome.how == "completed", run.outcome.problems
    found = run.ended("steps/wait_until").data
    assert (found["unit"], abs(found["changes"]["a"]) <= 10e-6) == ("g", True)
    assert found["waited_s"] == pytest.approx(660, abs=61), "warm-up and self-heating balance, whoever looks"


def test_the_rule_may_be_in_the_unit_of_the_output(tmp_path):
    bench = bench_of("telemetry")
    step = TO_G.replace("10 µg", "4 code")
    run = run_plan(tmp_path / "run", plan_of(tmp_path, steps(ON, UP, step) + OFF, tail=OUTPUT, bench=bench), bench)
    assert run.outcome.how == "completed", run.outcome.problems
    found = run.ended("steps/wait_until").data
    assert (found["unit"], abs(found["changes"]["a"]) <= 4) == ("code", True)


def test_a_unit_of_which_nothing_comes_is_told_of_in_words(tmp_path):
    fault = FaultSimulation.model_validate({"unit": "a", "kind": "dead", "at": "20 s"})
    bench = bench_of("telemetry")
    bench = bench.model_copy(update={"simulation": bench.simulation.model_copy(update={"faults": (fault,)})})
    step = TO_G.replace("3 h", "10 min")
    run = run_plan(tmp_path / "run", plan_of(tmp_path, steps(ON, UP, step) + OFF, tail=OUTPUT, bench=bench), bench)
    assert run.outcome.how == "error"
    assert "Too few usable readings of the output of the unit in place a over 6 min" in run.outcome.problems[0]


@pytest.mark.parametrize(
    ("name", "change", "nominal", "problem"),
    [
        ("volts", "1 pulse/s", None, "steady: is in pulse/s, expected a quantity in V"),
        ("telemetry", "1 mV", None, "steady: is in V, expected a quantity in code"),
        ("simulated", "1 µg", {"K1": "1.13 mA/g"}, "places.a of the bench file has no nominal K1 and S, which make it"),
    ],
)
def test_a_rule_that_an_output_cannot_be_held_against_is_refused(tmp_path, name, change, nominal, problem):
    bench = bench_of(name)
    if nominal is not None:
        place = bench.places["a"].model_copy(update={"nominal": Nominal.model_validate(nominal)})
        bench = bench.model_copy(update={"places": {"a": place}})
    (reported,) = problems_of(tmp_path, steps(ON, TO_G.replace("10 µg", change)) + OFF, tail=OUTPUT, bench=bench)
    assert problem in reported


def test_an_inertial_unit_is_not_waited_for(tmp_path):
    body = steps(ON.replace("15 V", "28 V"), TO_G.replace("output,", "counter,")) + OFF
    tail = "schema: itb-sequence/1\ntitle: T\nneeds: {supply: power_supply, counter: pulse_counter}\n"
    (reported,) = problems_of(tmp_path, body, tail=tail, bench=bench_of("imu"))
    assert "'steady' is for units with one channel; place 'a' is for an inertial unit" in reported
