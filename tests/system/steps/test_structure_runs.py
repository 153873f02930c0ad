"""Whole runs of every block in virtual time: which way they take, what overlaps, what happens when something fails."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.engine.state import replayed
from drivers.errors import CODES
from tests.support.engines import run_plan
from tests.support.runs import copy_bench
from tests.support.sequences import BENCH, ROOT, TAIL, plan_of, steps

TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
TABLE_TAIL = """\
schema: itb-sequence/1
title: Test
needs: {table: rate_table, counter: pulse_counter, supply: power_supply, unit_temperature: thermometer}
"""
MEASURE = "{measure: unit_temperature, as: t}"
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
OFF = "teardown: [{set: supply, output: off}]\n"
NEVER = "{wait_until: unit_temperature, above: 90 °C, give_up_after: 10 s}"
LATCH_ID = 0x100
LATCHES_PER_S = 10


def ran(folder, *lines, more="", tail=TAIL, bench=BENCH, script=None, faults=""):
    """A run of steps; whatever it is, its journal leads to the state that the engine ends with."""
    if faults:
        bench = load_bench(copy_bench(folder / "config", faults=faults)).bench
    run = run_plan(folder / "run", plan_of(folder, steps(*lines) + more, tail=tail, bench=bench), bench, script)
    assert replayed(run.events) == run.state
    assert run.state.under_way == ()
    assert run.state.questions == ()
    return run


def turned(folder, *lines, **options):
    return ran(folder, *lines, tail=TABLE_TAIL, bench=TABLE, **options)


def completed(run):
    return (run.outcome.how, run.outcome.problems, run.made_safe) == ("completed", [], {})


def after(seconds, act):
    """A script that does something to the engine when it has run so long."""

    async def script(engine):
        await asyncio.sleep(seconds)
        act(engine)

    return script


def at_step(name, act):
    """A script that does something to the engine a moment after a step has begun."""

    async def script(engine):
        while name not in engine.journal.state.under_way:  # noqa: ASYNC110  there is nothing to be told by
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
        act(engine)

    return script


# Ways


@pytest.mark.parametrize(("limit", "way"), [("10 °C", "then"), ("30 °C", "else")])
def test_a_measured_condition_takes_the_right_way(tmp_path, limit, way):
    block = f"{{if: \"${{t > '{limit}'}}\", then: [note: 'Warm, ${{t}}.'], else: [note: 'Cold, ${{t}}.']}}"
    run = ran(tmp_path, MEASURE, block)
    assert completed(run)
    assert run.steps() == ["steps/measure", f"steps/{way}/note"]
    assert run.events[-1].kind == "made_safe"
    words = {"then": "Warm", "else": "Cold"}[way]
    assert run.ended(f"steps/{way}/note").data["note"] == f"{words}, {run.state.variables['t']}."


def test_a_measured_loop_goes_on_until_its_condition_is_over(tmp_path):
    loop = "{while: \"${t < '29 °C'}\", at_most: 60, steps: [wait: 1 min, " + MEASURE + "]}"
    run = ran(tmp_path, MEASURE, "{ramp: chamber, to: 30 °C, at: 3 °C/min}", loop)
    assert completed(run)
    values = [event.data["value"] for event in run.events if event.data.get("as") == "t"]
    passes = [step for step in run.steps() if step.endswith("/wait")]
    assert len(values) == len(passes) + 1 > 2
    assert passes == [f"steps/while/pass={number}/wait" for number in range(1, len(passes) + 1)]
    assert all(value < 29 for value in values[1:-1])
    assert values[-1] >= 29


def test_a_measured_loop_that_is_over_before_it_begins_is_left_out(tmp_path):
    run = ran(tmp_path, MEASURE, "{while: \"${t > '50 °C'}\", at_most: 2, steps: [wait: 1 min]}", "wait: 1 s")
    assert completed(run)
    assert run.steps() == ["steps/measure", "steps/wait"]


def test_a_measured_loop_at_its_bound_fails_in_words(tmp_path):
    run = ran(tmp_path, MEASURE, "{while: \"${t < '50 °C'}\", at_most: 3, steps: [wait: 1 s]}", "wait: 2 s", more=OFF)
    assert run.outcome.problems == [
        f"{tmp_path / 's.yaml'}:3:5: steps/while: its condition ${{t < '50 °C'}} is still true after 3 passes. Find "
        "out why, or increase at_most."
    ]
    assert run.steps() == ["steps/measure", *(f"steps/while/pass={n}/wait" for n in (1, 2, 3)), "teardown/set"]


def test_a_condition_over_what_was_not_measured_on_this_way_fails_in_words(tmp_path):
    first = "{if: \"${t > '50 °C'}\", then: [{measure: unit_temperature, as: u}]}"
    run = ran(tmp_path, MEASURE, first, "{if: \"${u > '5 °C'}\", then: [wait: 1 s]}")
    (problem,) = run.outcome.problems
    assert problem.startswith(f"{tmp_path / 's.yaml'}:4:5: steps/if#2: \"${{u > '5 °C'}}\": there is no name 'u'")
    assert problem.endswith(f"Measured so far: t = {run.state.variables['t']}")


def test_a_step_over_a_measurement_is_held_against_the_limits_of_the_bench(tmp_path):
    run = ran(tmp_path, MEASURE, "{ramp: chamber, to: \"${t + '200 °C'}\", at: 1 °C/min}", more=OFF)
    assert "is above the 100 °C that the bench file allows 'chamber'. Nothing was sent." in run.outcome.problems[0]
    assert run.steps() == ["steps/measure", "teardown/set"]
    assert run.series["chamber.set_point"].values.max() <= 25, "where it is safe"


# At the same time


def test_branches_overlap_and_the_block_ends_with_the_last(tmp_path):
    heat = "heat: [{ramp: chamber, to: 25 °C, at: 1 °C/min}]"
    turn = "turn: [{move: head, to: 90°}, {move: head, to: 0°}]"
    run = ran(tmp_path, f"{{parallel: {{{heat}, {turn}}}}}", "wait: 1 s")
    assert completed(run)
    ramp, back = "steps/parallel/heat/ramp", "steps/parallel/turn/move#2"
    assert run.begun(ramp).at_s == run.begun("steps/parallel/turn/move").at_s
    assert run.begun(ramp).at_s < run.ended(back).at_s < run.ended(ramp).at_s
    assert run.begun("steps/wait").at_s == pytest.approx(run.ended(ramp).at_s, abs=0.01)
    assert run.ended(ramp).at_s - run.begun(ramp).at_s == pytest.approx(300, abs=20)


def test_a_branch_that_fails_ends_the_others_and_brings_them_to_rest(tmp_path):
    branches = f"{{parallel: {{a: [{{rotate: table, at: 20 °/s, for: 5 min}}], b: [{NEVER}]}}}}"
    group = f"{{group: g, on_failure: continue, steps: [{branches}]}}"
    run = turned(tmp_path, group, "wait: 30 s")
    assert run.outcome.how == "completed"
    (failed,), (cut,) = (run.steps(kind) for kind in ("step_failed", "step_cut"))
    assert (failed, cut) == ("steps/g/parallel/b/wait_until", "steps/g/parallel/a/rotate")
    rates = run.series["table.rate"]
    assert 20.0 in rates.values
    resting = rates.between(run.begun("steps/wait").at_s + 1, run.ended("steps/wait").at_s)
    assert len(resting.values) > 20
    assert set(resting.values) == {0.0}


def test_a_timeout_in_a_branch_ends_the_block_in_words(tmp_path):
    branches = "{parallel: {a: [wait: 1 h], b: [{ramp: chamber, to: 30 °C, at: 1 °C/min, timeout: 1 min}]}}"
    run = ran(tmp_path, branches, more=OFF)
    assert "step steps/parallel/b/ramp: takes longer than its timeout of 60 s." in run.outcome.problems[0]
    assert run.steps() == ["teardown/set"]
    assert run.steps("step_cut") == ["steps/parallel/a/wait"]
    assert run.ended("teardown/set").at_s < 75, "a rehearsal looks at frames every 10 s"


def test_what_a_timeout_has_cut_short_comes_to_rest(tmp_path):
    cut = "{ramp: chamber, to: 30 °C, at: 1 °C/min, timeout: 1 min, on_failure: continue}"
    run = ran(tmp_path, cut, "wait: 10 min")
    assert run.outcome.how == "completed"
    assert run.series["chamber.set_point"].values.max() == pytest.approx(21, abs=0.2), "the ramp is held there"


# Failures


def test_attempts_go_on_until_one_succeeds_and_no_further(tmp_path):
    wait = "{wait_until: unit_temperature, above: 29 °C, give_up_after: 2 min}"
    attempts = f"{{retry: 20, delay: 30 s, on: [step], steps: [wait: 1 s, {wait}]}}"
    run = ran(tmp_path, "{ramp: chamber, to: 30 °C, at: 3 °C/min}", attempts)
    assert completed(run)
    again = [event.data["attempt"] for event in run.events if event.kind == "retried"]
    assert again == list(range(1, len(again) + 1))
    assert 1 < len(again) < 19
    waits = [f"steps/retry/wait{f'~{number}' if number > 1 else ''}" for number in range(1, len(again) + 2)]
    assert [step for step in run.steps() if "/wait" in step and "until" not in step] == waits
    assert run.begun("steps/retry/wait~2").at_s - run.events_of("retried")[0].at_s == pytest.approx(30, abs=0.1)


@pytest.mark.parametrize(
    ("codes", "attempts"), [(CODES, 3), (("refused", "settle"), 3), (("silent",), 1), (("step",), 1)]
)
def test_attempts_follow_the_errors_that_they_name_and_end(tmp_path, codes, attempts):
    block = f"{{retry: 3, delay: 1 s, on: [{', '.join(codes)}], steps: [{{move: head, to: 90°}}]}}"
    run = ran(tmp_path, block, more=OFF, faults="[{device: head, kind: stuck, at: 0 s}]")
    assert run.outcome.how == "error"
    assert len(run.steps("step_failed")) == attempts
    assert len(run.steps("retried")) == attempts - 1
    assert "/move: head: " in run.outcome.problems[0].replace("~3", "")
    assert run.steps() == ["teardown/set"]


def test_a_measurement_outside_its_limits_is_taken_again_only_where_it_is_said_to_stop(tmp_path):
    limits = "limits: {min: 29 °C}"
    again = (
        f"{{retry: 60, delay: 1 min, on: [step], steps: [{{measure: unit_temperature, {limits}, on_failure: stop}}]}}"
    )
    run = ran(tmp_path, "{ramp: chamber, to: 30 °C, at: 3 °C/min}", again)
    verdicts = [event.data["verdict"] for event in run.events if "verdict" in event.data]
    assert run.outcome.how == "completed"
    assert verdicts[-1] == "PASS"
    assert set(verdicts[:-1]) == {"FAIL"}
    assert run.state.limits_failed[0] == "steps/retry/measure"


def test_a_step_that_fails_is_passed_over_where_the_sequence_says_so(tmp_path):
    run = ran(tmp_path, NEVER[:-1] + ", on_failure: continue}", "wait: 1 s")
    assert run.outcome.how == "completed"
    assert run.steps() == ["steps/wait"]
    assert run.state.left_out == ("steps/wait_until",)
    assert any("goes on without it" in notice for notice in run.notices)


@pytest.mark.parametrize("on_failure", ["", ", on_failure: stop"])
def test_a_step_that_fails_ends_the_run_otherwise(tmp_path, on_failure):
    run = ran(tmp_path, f"{NEVER[:-1]}{on_failure}}}", "wait: 1 s", more=OFF)
    assert run.outcome.how == "error"
    assert run.steps() == ["teardown/set"]


def when_asked(act):
    """A script that answers every question."""

    async def script(engine):
        while True:
            await asyncio.sleep(1)
            for question in engine.prompts.questions:
                act(engine, question)

    return script


@pytest.mark.parametrize(
    ("answer", "failed", "ended"),
    [("stop", 1, ["teardown/set"]), ("continue", 1, ["steps/wait", "teardown/set"]), ("repeat", 3, ["teardown/set"])],
)
def test_a_person_is_asked_what_happens_after_a_failure(tmp_path, answer, failed, ended):
    answers = iter([answer] * (failed - 1) + ["stop" if answer == "repeat" else answer])
    script = when_asked(lambda engine, question: engine.prompts.answer(next(answers), "operator", question.step))
    run = ran(tmp_path, NEVER[:-1] + ", on_failure: ask}", "wait: 1 s", more=OFF, script=script)
    assert len(run.steps("step_failed")) == failed
    assert run.steps() == ended
    assert run.events_of("asked")[0].data["expected"] == "stop, continue, repeat"
    assert run.outcome.how == ("completed" if answer == "continue" else "error")


def test_a_run_can_be_stopped_while_a_person_is_asked(tmp_path):
    script = when_asked(lambda engine, _: engine.stop())
    run = ran(tmp_path, NEVER[:-1] + ", on_failure: ask}", more=OFF, script=script)
    assert run.outcome.problems == ["ended by the operator"]
    assert run.steps("unanswered") == ["steps/wait_until?"]
    assert run.steps() == ["teardown/set"]


def test_a_step_around_others_goes_by_its_own_on_failure_and_timeout(tmp_path):
    around = f"{{rotate: table, at: 20 °/s, on_failure: continue, during: [{NEVER}]}}"
    late = "{rotate: table, at: 20 °/s, on_failure: continue, timeout: 5 s, during: [wait: 1 h]}"
    run = turned(tmp_path, around, late, "wait: 5 s")
    assert run.outcome.how == "completed"
    assert run.state.left_out == ("steps/rotate", "steps/rotate#2")
    assert run.steps("step_failed") == ["steps/rotate/wait_until", "steps/rotate", "steps/rotate#2"]
    assert run.steps("step_cut") == ["steps/rotate#2/wait"]
    assert run.begun("steps/wait").at_s < 25
    assert run.series["table.rate"].values[-1] == 0.0


def test_the_teardown_of_a_group_runs_after_its_steps_and_the_inner_one_first(tmp_path):
    inner = "{group: b, steps: [wait: 2 s], teardown: [wait: 3 s]}"
    run = ran(tmp_path, f"{{group: a, setup: [wait: 1 s], steps: [{inner}], teardown: [wait: 4 s]}}", "wait: 5 s")
    assert completed(run)
    assert run.steps() == [
        "steps/a/setup/wait", "steps/a/b/wait", "steps/a/b/teardown/wait", "steps/a/teardown/wait", "steps/wait",
    ]  # fmt: skip


NESTED = (
    "{group: a, steps: [{group: b, setup: [wait: 1 s], steps: [STEP, wait: 1 s], teardown: [NEVER, wait: 2 s]}], "
    "teardown: [wait: 3 s]}"
).replace("NEVER", NEVER)


def test_the_teardown_of_a_group_runs_when_a_step_fails_and_goes_on_when_a_step_of_its_own_fails(tmp_path):
    run = ran(tmp_path, NESTED.replace("STEP", NEVER), "wait: 5 s", more=OFF)
    assert run.outcome.how == "error"
    assert run.steps() == ["steps/a/b/setup/wait", "steps/a/b/teardown/wait", "steps/a/teardown/wait", "teardown/set"]
    assert len(run.outcome.problems) == 2


def test_the_teardown_of_a_group_runs_when_its_setup_fails(tmp_path):
    run = ran(tmp_path, f"{{group: a, setup: [{NEVER}], steps: [wait: 1 s], teardown: [wait: 2 s]}}", more=OFF)
    assert run.steps() == ["steps/a/teardown/wait", "teardown/set"]


def test_the_teardown_of_a_group_runs_when_the_run_is_stopped(tmp_path):
    stop = at_step("steps/a/b/wait", lambda engine: engine.stop())
    run = ran(tmp_path, NESTED.replace("STEP, wait: 1 s", "wait: 1 h"), more=OFF, script=stop)
    assert run.outcome.problems[-1] == "ended by the operator"
    assert run.steps("step_cut") == ["steps/a/b/wait"]
    assert run.steps() == ["steps/a/b/setup/wait", "steps/a/b/teardown/wait", "steps/a/teardown/wait", "teardown/set"]


def test_no_teardown_runs_when_the_run_is_aborted(tmp_path):
    abort = at_step("steps/a/b/wait", lambda engine: engine.abort())
    run = ran(tmp_path, NESTED.replace("STEP, wait: 1 s", "wait: 1 h"), more=OFF, script=abort)
    assert run.outcome.how == "aborted"
    assert run.steps() == ["steps/a/b/setup/wait"]
    assert run.events[-1].at_s < 10
    assert run.made_safe == {}


def test_an_abort_ends_the_teardown_of_a_group_at_once(tmp_path):
    slow = "{group: g, steps: [wait: 1 h], teardown: [wait: 2 h, wait: 3 h]}"
    branches = f"{{parallel: {{a: [{NEVER}], b: [{slow}]}}}}"
    abort = at_step("steps/parallel/b/g/teardown/wait", lambda engine: engine.abort())
    run = ran(tmp_path, branches, more=OFF, script=abort)
    assert run.steps() == []
    assert run.events[-1].at_s < 20
    assert run.made_safe == {}


def test_an_interlock_that_aborts_ends_the_teardown_of_a_group_too(tmp_path):
    hot = "interlocks: {hot: {reading: unit_temperature, above: 5 °C, for: 30 s, then: abort}}\n"
    fault = "[{device: chamber, kind: silent, at: 20 s}]"
    run = ran(tmp_path, "{group: g, steps: [wait: 1 h], teardown: [wait: 2 h]}", more=hot + OFF, faults=fault)
    assert run.begun("steps/g/teardown/wait").at_s < 35
    assert run.steps() == []
    assert run.events[-1].at_s < 60
    assert set(run.made_safe) == {"chamber"}


def test_a_stop_does_not_cut_the_teardown_of_a_group_short(tmp_path):
    group = f"{{group: g, on_failure: continue, steps: [{NEVER}], teardown: [wait: 20 s, wait: 30 s]}}"
    stop = at_step("steps/g/teardown/wait", lambda engine: engine.stop())
    run = ran(tmp_path, group, "wait: 1 h", more=OFF, script=stop)
    assert run.outcome.how in ("aborted", "error")
    assert run.steps() == ["steps/g/teardown/wait", "steps/g/teardown/wait#2", "teardown/set"]


def test_a_fault_does_not_cut_the_teardown_of_a_group_short_and_both_reasons_are_told(tmp_path):
    group = f"{{group: g, steps: [{NEVER}], teardown: [wait: 2 min, wait: 30 s]}}"
    run = ran(tmp_path, group, "wait: 1 h", more=OFF, faults="[{device: chamber, kind: silent, at: 1 min}]")
    assert run.steps() == ["steps/g/teardown/wait", "steps/g/teardown/wait#2", "teardown/set"]
    first, second = run.outcome.problems
    assert "steps/g/wait_until: unit_temperature is" in first
    assert "chamber: no answer within 3 s" in second


def test_after_the_step_under_way_means_after_that_of_every_branch(tmp_path):
    branches = "{parallel: {a: [wait: 10 s, wait: 20 s], b: [wait: 30 s, wait: 40 s]}}"
    stop = after(5, lambda engine: engine.stop_after_step())
    run = ran(tmp_path, branches, "wait: 1 s", more=OFF, script=stop)
    assert run.outcome.problems == ["ended by the operator"]
    assert run.steps() == ["steps/parallel/a/wait", "steps/parallel/b/wait", "teardown/set"]


# Measuring


def latches(run, step):
    return run.frames[step]["counter"].ids == LATCH_ID


def test_frames_are_kept_from_the_beginning_of_the_steps_inside_to_their_end(tmp_path):
    inside = "{move: head, to: 90°}, wait: 20 s, " + MEASURE
    run = ran(tmp_path, "wait: 5 s", f"{{acquire: counter, label: moving, during: [{inside}]}}", "wait: 5 s")
    assert completed(run)
    done = run.ended("steps/acquire")
    assert done.data["label"] == "moving"
    begin_s, end_s = done.data["begin_s"], done.data["end_s"]
    assert begin_s == pytest.approx(run.begun("steps/acquire/move").at_s, abs=0.05)
    assert end_s == pytest.approx(run.ended("steps/acquire/measure").at_s, abs=0.2)
    at_s = run.frames["steps/acquire"]["counter"].at_s
    assert begin_s - 0.2 <= at_s.min() < begin_s + 0.2
    assert end_s - 0.2 < at_s.max() <= end_s + 0.2
    assert latches(run, "steps/acquire").sum() == pytest.approx((end_s - begin_s) * LATCHES_PER_S, abs=3)
    assert set(run.frames) == {"steps/acquire"}


def test_a_counter_that_fails_ends_the_steps_that_it_counts_during(tmp_path):
    block = "{acquire: counter, label: a, during: [wait: 1 h]}"
    run = ran(tmp_path, block, more=OFF, faults="[{device: counter, kind: silent, at: 1 min}]")
    assert run.outcome.how == "error"
    assert "counter: counter frames have stopped" in run.outcome.problems[0]
    assert run.ended("teardown/set").at_s < 75, "a rehearsal looks at frames every 10 s"
    assert latches(run, "steps/acquire").sum() == pytest.approx(59 * LATCHES_PER_S, abs=20)


def test_a_tare_is_the_zero_of_later_measurements(tmp_path):
    lines = [ON, "wait: 5 s", "{move: head, to: 90°}", "{tare: counter.x, for: 20 s}"]
    both = ["{measure: counter.x, for: 20 s, as: gross}", "{measure: counter.x, for: 20 s, net: true, as: net}"]
    run = ran(tmp_path, *lines, *both, more=OFF)
    assert completed(run)
    tare, gross, net = (run.ended(f"steps/{step}").data["value"] for step in ("tare", "measure", "measure#2"))
    assert abs(gross) == pytest.approx(11_300, rel=0.02), "one g"
    assert run.state.tares["counter.x"].value == tare
    single_u, net_u = (run.ended(f"steps/{step}").data["u"] for step in ("measure", "measure#2"))
    assert net_u == pytest.approx(math.sqrt(2) * single_u, rel=0.02), "the tare scatters as well"
    assert net == pytest.approx(0, abs=2)
    assert gross == pytest.approx(tare, abs=2)


def test_a_net_measurement_needs_a_tare(tmp_path):
    run = ran(tmp_path, "{measure: counter.x, for: 5 s, net: true, as: net}")
    assert "counter.x has not been tared; put a tare step before this one" in run.outcome.problems[0]


@pytest.mark.parametrize(
    ("limits", "verdict", "marginal"),
    [
        ("min: 15 °C, max: 25 °C", "PASS", False),
        ("max: 15 °C", "FAIL", False),
        ("min: 19.8 °C", "PASS", True),
        ("min: 20.2 °C", "FAIL", True),
        ("min: 19.8 °C, marginal: 0.01 °C", "PASS", False),
        ("target: 20 °C, tolerance: 2 °C, guard: 2", "PASS", False),
        ("min: 19.8 °C, guard: 2", "FAIL", True),
        ("target: 20 °C, tolerance: 0.2 °C, guard: 2", "INVALID", True),
        ("u_max: 0.4 °C", "PASS", False),
        ("min: 15 °C, u_max: 0.2 °C", "INVALID", False),
        ("max: 15 °C, u_max: 0.2 °C", "FAIL", False),
    ],
)
def test_a_measurement_is_held_against_its_limits_and_the_run_goes_on(tmp_path, limits, verdict, marginal):
    """The thermometer reads 19.93 °C with a standard uncertainty of 0.3 °C, by its certificate."""
    run = ran(tmp_path, f"{{measure: unit_temperature, limits: {{{limits}}}}}", "wait: 1 s")
    assert run.outcome.how == "completed"
    found = run.ended("steps/measure").data
    assert (found["verdict"], found["marginal"]) == (verdict, marginal)
    assert found["u"] == pytest.approx(0.3, abs=0.01)
    assert run.state.limits_failed == (("steps/measure",) if verdict == "FAIL" else ())
    assert run.state.undecided == (("steps/measure",) if verdict == "INVALID" else ())
    assert run.steps()[-1] == "steps/wait"


def test_a_measurement_outside_its_limits_ends_the_run_where_it_is_said_to(tmp_path):
    run = ran(tmp_path, "{measure: unit_temperature, limits: {max: 5 °C}, on_failure: stop}", "wait: 1 s", more=OFF)
    assert "step steps/measure: unit_temperature is outside its limits" in run.outcome.problems[0]
    assert run.steps() == ["steps/measure", "teardown/set"]


@pytest.mark.parametrize("keys", ["as: v", "as: v, for: 2 s", "as: v, for: 30 s"])
def test_a_measurement_is_of_its_own_time_and_not_of_before(tmp_path, keys):
    """The supply is asked every ten seconds; what it said last was of before it was switched on."""
    run = ran(tmp_path, "wait: 12 s", ON, f"{{measure: supply.voltage, {keys}}}", more=OFF)
    assert run.ended("steps/measure").data["value"] == pytest.approx(15, abs=0.01)


# Turning


def test_relative_moves_and_the_nearest_way_go_on_from_where_the_last_move_went(tmp_path):
    moves = [
        "{move: head, to: 170°}",
        "{move: head, by: 100°}",
        "{move: head, to: 0°, way: nearest}",
        "{move: head, by: -90°}",
    ]
    run = ran(tmp_path, *moves)
    assert completed(run)
    at_deg = [event.data["angle_deg"] for event in run.events if "angle_deg" in event.data]
    assert at_deg == pytest.approx([170, 270, 360, 270], abs=1e-3)


def test_a_relative_move_after_one_that_was_cut_short_begins_where_the_head_stands(tmp_path):
    cut = "{move: head, to: 300°, timeout: 5 s, on_failure: continue}"
    run = ran(tmp_path, cut, "{move: head, by: 10°}")
    assert run.outcome.how == "completed"
    stood_deg = run.ended("steps/move#2").data["angle_deg"] - 10
    assert 50 < stood_deg < 120, "20 °/s for five seconds, and the way until it stood"


def test_a_table_turns_for_a_time_and_so_many_turns_and_is_at_rest_after_each(tmp_path):
    run = turned(
        tmp_path, "{rotate: table, at: 30 °/s, for: 10 s}", "wait: 3 s", "{rotate: table, at: -90 °/s, turns: 3}"
    )
    assert completed(run)
    assert [run.ended(f"steps/{step}").data["rate_dps"] for step in ("rotate", "rotate#2")] == [30.0, -90.0]
    rates, angles = run.series["table.rate"], run.series["table.angle"]
    pause = rates.between(run.begun("steps/wait").at_s, run.ended("steps/wait").at_s)
    assert set(pause.values) == {0.0}
    assert angles.values.max() == pytest.approx(300, abs=10)
    assert angles.values.max() - angles.values[-1] == pytest.approx(3 * 360, abs=30)
    assert not run.moving


def test_a_table_turns_while_turns_are_counted(tmp_path):
    inside = "{acquire: counter, turns: 3, of: table, label: a}, wait: 1 s"
    run = turned(tmp_path, f"{{rotate: table, at: 60 °/s, during: [{inside}]}}", "wait: 2 s")
    assert completed(run)
    done = run.ended("steps/rotate/acquire").data
    assert done["end_s"] - done["begin_s"] == pytest.approx(18, abs=0.2)
    assert latches(run, "steps/rotate/acquire").sum() == pytest.approx(180, abs=4)
    assert run.series["table.rate"].values[-1] == 0.0
    assert not run.moving


def test_turns_of_a_table_that_stands_are_told_not_to_come(tmp_path):
    run = turned(tmp_path, "{acquire: counter, turns: 3, of: table, label: a}")
    assert "put this step into the 'during' of a rotate" in run.outcome.problems[0]


@pytest.mark.parametrize(
    ("keys", "frequencies_hz", "least_s"),
    [
        ("frequency: 0.5 Hz, for: 10 s", [0.5], 10),
        ("sweep: {from: 1 Hz, to: 2 Hz}, for: 14 s", list(2 ** (np.arange(7) / 6)), 14),
        ("sweep: {from: 2 Hz, to: 1 Hz}, for: 14 s", list(2 ** (np.arange(6, -1, -1) / 6)), 14),
    ],
)
def test_a_table_oscillates_and_is_at_rest_after_it(tmp_path, keys, frequencies_hz, least_s):
    run = turned(tmp_path, f"{{oscillate: table, amplitude: 5°, {keys}}}", "wait: 3 s")
    assert completed(run)
    done = run.ended("steps/oscillate")
    assert done.data["frequencies_hz"] == pytest.approx(frequencies_hz)
    assert done.at_s - run.begun("steps/oscillate").at_s >= least_s
    swinging = run.series["table.angle"].between(run.begun("steps/oscillate").at_s, done.at_s)
    assert 3 < abs(swinging.values).max() < 6, "about where it stood, also after it has stopped between two frequencies"
    assert run.series["table.rate"].values[-1] == 0.0
    assert not run.moving


def test_a_table_oscillates_while_other_steps_are_done(tmp_path):
    inside = "{acquire: counter, for: 8 s, label: a}"
    run = turned(tmp_path, f"{{oscillate: table, amplitude: 5°, frequency: 1 Hz, during: [{inside}]}}", "wait: 2 s")
    assert completed(run)
    assert latches(run, "steps/oscillate/acquire").sum() == pytest.approx(80, abs=3)
    counted = run.begun("steps/oscillate/acquire").at_s, run.ended("steps/oscillate/acquire").at_s
    assert len(set(run.series["table.angle"].between(*counted).values)) > 3
    assert run.series["table.rate"].values[-1] == 0.0


@pytest.mark.parametrize(
    "block",
    [
        f"{{rotate: table, at: 60 °/s, during: [{NEVER}]}}",
        f"{{oscillate: table, amplitude: 5°, frequency: 1 Hz, during: [{NEVER}]}}",
        "{rotate: table, at: 60 °/s, for: 1 h, timeout: 2 h, on_failure: continue}",
    ],
)
def test_a_table_is_at_rest_after_a_failure_and_after_a_stop(tmp_path, block):
    stop = after(12, lambda engine: engine.stop()) if "1 h" in block else None
    run = turned(tmp_path, block, more="teardown: [wait: 5 s, {set: supply, output: off}]\n", script=stop)
    rates = run.series["table.rate"]
    resting = rates.between(run.begun("teardown/wait").at_s, run.ended("teardown/wait").at_s)
    assert abs(rates.values).max() > 1
    assert set(resting.values) == {0.0}, "before the teardown begins"
    assert not run.moving


# A fault of another instrument


BUSY = {
    "alternatives": [MEASURE, "{if: \"${t > '5 °C'}\", then: [wait: 1 h]}"],
    "passes": [MEASURE, "{while: \"${t > '5 °C'}\", at_most: 999, steps: [wait: 10 s]}"],
    "branches": ["{parallel: {a: [wait: 1 h], b: [{move: head, to: 90°}, wait: 2 h]}}"],
    "attempts": ["{retry: 50, on: [step, silent, window], steps: [wait: 1 h]}"],
    "group": ["{group: g, on_failure: continue, steps: [wait: 1 h], teardown: [wait: 5 s]}", "wait: 1 h"],
    "meanwhile": ["{acquire: counter, label: a, during: [wait: 1 h]}"],
    "product": ["{for_each: {a: [1, 2], b: [3, 4]}, steps: [{wait: 1 h, on_failure: continue}]}"],
}


@pytest.mark.parametrize("lines", BUSY.values(), ids=BUSY)
@pytest.mark.parametrize("silent", [True, False], ids=["silent", "out_of_its_window"])
def test_a_fault_ends_whatever_is_under_way_and_leaves_everything_safe(tmp_path, lines, silent):
    faults = "[{device: source, kind: silent, at: 1 min}]" if silent else ""
    bench = BENCH
    if not silent:
        edit = ("supply_current: {min: 30 mA, max: 110 mA}", "supply_current: {min: 70 mA, max: 110 mA}")
        bench = load_bench(copy_bench(tmp_path / "config", edit)).bench
    run = ran(tmp_path, ON, *lines, more=OFF, faults=faults, bench=bench)
    assert run.outcome.how == "error"
    expected = "source: no answer within 2 s" if silent else "the units draw 60 mA, expected 70 to 110 mA"
    assert expected in run.outcome.problems[0]
    assert len(run.outcome.problems) == 1
    assert set(run.made_safe) == ({"source"} if silent else set())
    assert run.ended("teardown/set").data["output"] is False
    assert run.events[-1].at_s < 90
    assert (run.powered, run.moving) == (False, False)


@pytest.mark.parametrize(
    "block",
    [
        "{rotate: table, at: 60 °/s, for: 1 h}",
        "{rotate: table, at: 60 °/s, during: [wait: 1 h]}",
        "{rotate: table, at: 60 °/s, during: [{acquire: counter, turns: 900, of: table, label: a}]}",
        "{oscillate: table, amplitude: 5°, frequency: 1 Hz, for: 1 h}",
        "{oscillate: table, amplitude: 5°, sweep: {from: 1 Hz, to: 2 Hz}, for: 1 h}",
        "{parallel: {a: [{rotate: table, at: 60 °/s, for: 1 h}], b: [wait: 1 h]}}",
    ],
)
def test_a_fault_leaves_the_table_at_rest(tmp_path, block):
    edit = ("limits: {min: -55 °C, max: 105 °C}", "limits: {min: -55 °C, max: 19 °C}")
    folder = tmp_path / "config"
    copy_bench(folder)
    path = folder / "rate_table.yaml"
    path.write_text(path.read_text("utf-8").replace(*edit), "utf-8")
    bench = load_bench(path).bench
    run = ran(tmp_path, ON, block, more=OFF, tail=TABLE_TAIL, bench=bench)
    assert run.outcome.how == "error"
    assert "outside -55 to 19 °C" in run.outcome.problems[0]
    assert run.made_safe == {}
    assert run.ended("teardown/set").data["output"] is False
    assert (run.powered, run.moving) == (False, False)
