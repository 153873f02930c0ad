"""Unrolling: the steps of a plan in their order, their ids and values, and each problem of a loop told once."""

from __future__ import annotations

import pytest

from bench.sequence.language.values import in_words
from bench.sequence.plan import expand
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move, Ramp
from bench.sequence.steps.waits import Soak, Wait
from tests.support.sequences import BENCH, ROOT, load_plan, plan_of, problems_of, steps


def loop(variable: str, values: str, *inside: str) -> str:
    return f"{{for_each: {variable}, in: {values}, steps: [{', '.join(inside)}]}}"


def ids(plan) -> list[str]:
    return [planned.id for planned in plan]


# Ids


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("wait: 1 s", ["wait"]),
        (loop("a", "[1, 2]", "wait: 1 s"), ["a=1/wait", "a=2/wait"]),
        (loop("a", "[1, 2, 1, 1]", "wait: 1 s"), ["a=1/wait", "a=2/wait", "a=1#2/wait", "a=1#3/wait"]),
        (loop("a", "[1]", "wait: 1 s", "wait: 2 s"), ["a=1/wait", "a=1/wait#2"]),
        (
            loop("a", "[20 °C, -40 °C]", loop("b", "[0°, 90°, 0°]", "wait: 1 s")),
            ["a=20/b=0/wait", "a=20/b=90/wait", "a=20/b=0#2/wait",
             "a=-40/b=0/wait", "a=-40/b=90/wait", "a=-40/b=0#2/wait"],
        ),
        (
            loop("a", "[1]", loop("b", "[1]", "wait: 1 s"), "wait: 1 s", loop("b", "[1]", "wait: 1 s")),
            ["a=1/b=1/wait", "a=1/wait", "a=1/b=1#2/wait"],
        ),
        (
            loop("a", "[true, x, 1.50, 2 min, 1e-7]", "wait: 1 s"),
            ["a=true/wait", "a=x/wait", "a=1.5/wait", "a=120/wait", "a=1e-07/wait"],
        ),
        (loop("a", "[0.1, 0.10000000000000001]", "wait: 1 s"), ["a=0.1/wait", "a=0.1#2/wait"]),
        (
            "{repeat: 2, steps: [wait: 1 s, wait: 2 s]}",
            ["pass=1/wait", "pass=1/wait#2", "pass=2/wait", "pass=2/wait#2"],
        ),
        (
            "{repeat: '${1 + 1}', steps: [{repeat: 1, steps: [wait: 1 s]}]}",
            ["pass=1/pass=1/wait", "pass=2/pass=1/wait"],
        ),
        ("{group: warm_up, steps: [wait: 1 s, wait: 2 s]}", ["warm_up/wait", "warm_up/wait#2"]),
        (loop("a", "[1, 2]", "{group: b, steps: [wait: 1 s]}"), ["a=1/b/wait", "a=2/b/wait"]),
    ],
)  # fmt: skip
def test_an_id_names_a_step_by_its_loops_and_the_visit_of_the_same_value(tmp_path, block, expected):
    assert ids(plan_of(tmp_path, steps(block))) == [f"steps/{name}" for name in expected]


def test_ids_of_the_shipped_tumble_are_unique_and_in_order():
    plan = load_plan(ROOT / "sequences/tumble_static.yaml", BENCH)
    assert len(set(ids(plan))) == len(plan) == 421
    assert ids(plan)[:5] == [
        "setup/move", "setup/then/set", "setup/then/wait", "steps/cycle=1/temperature=20/ramp",
        "steps/cycle=1/temperature=20/soak",
    ]  # fmt: skip
    assert ids(plan)[-1] == "teardown/soak"
    visits = [name for name in ids(plan) if "temperature=20" in name and name.endswith("ramp")]
    assert visits == [f"steps/cycle=1/temperature=20{visit}/ramp" for visit in ("", "#2", "#3")]


def test_a_step_knows_its_loops_outermost_first_and_its_place(tmp_path):
    plan = plan_of(tmp_path, steps("wait: 1 s", loop("a", "[1]", loop("b", "[2 s]", "wait: '${b}'"))))
    last = plan.steps[-1]
    assert {name: in_words(value) for name, value in last.loops.items()} == {"a": "1", "b": "2 s"}
    assert list(last.loops) == ["a", "b"]
    assert plan.where(last.place) == f"{tmp_path / 's.yaml'}:3:69"
    assert plan.name == "s"
    assert plan.steps[0].loops == {}


def test_the_phases_stand_in_their_order_and_count_for_themselves(tmp_path):
    body = "teardown: [wait: 3 s]\nsteps: [wait: 2 s]\nsetup: [wait: 1 s]\n"
    plan = plan_of(tmp_path, body)
    assert ids(plan) == ["setup/wait", "steps/wait", "teardown/wait"]
    assert [planned.phase for planned in plan] == ["setup", "steps", "teardown"]
    assert [planned.step for planned in plan] == [Wait(wait=f"{seconds} s") for seconds in (1, 2, 3)]


# Values

NAMES = "parameters: {offset: {help: h, default: 1°}, on: {help: h, default: true}, soak: {help: h, default: 1 h}}\n"


def test_expressions_are_worked_out_with_parameters_and_the_names_of_loops(tmp_path):
    plan = plan_of(tmp_path, NAMES + steps(loop(
        "position", "[0°, 90°]",
        "{move: head, to: '${position + offset}', settle: '${soak / 60}'}",
        "wait: '${soak if on else soak * 2}'",
    )))  # fmt: skip
    assert [planned.step for planned in plan] == [
        Move(move="head", to="1°", settle="60 s"), Wait(wait="1 h"), Move(move="head", to="91°", settle="60 s"),
        Wait(wait="1 h"),
    ]  # fmt: skip


def test_every_kind_of_step_is_in_the_unit_that_its_name_states(tmp_path):
    stable = "{band: 0.2 °C, slope: 1 °C/h, hold: 10 min}"
    soak = f"{{soak: unit_temperature, at_least: 1 h, until_stable: {stable}, give_up_after: 4 h}}"
    ramp, move, soaked, counted, on = (planned.step for planned in plan_of(tmp_path, steps(
        "{ramp: chamber, to: -40 °C, at: 60 °C/h}",
        "{move: head, to: 0.25 turn, approach: from_below, settle: 1500 ms}",
        soak,
        "{acquire: counter, for: 1 min, label: tumble}",
        "{set: supply, voltage: 15000 mV, current_limit: 120 mA, output: on}",
    ) + "teardown: [{set: supply, output: off}]\n").steps)  # fmt: skip
    assert isinstance(ramp, Ramp)
    assert (ramp.temperature_c, ramp.rate_c_per_min) == (-40.0, 1.0)
    assert isinstance(move, Move)
    assert (move.to_deg, move.approach, move.settle_s) == (90.0, "from_below", 1.5)
    assert isinstance(soaked, Soak)
    assert soaked.until_stable is not None
    assert (soaked.at_least_s, soaked.give_up_after_s) == (3600.0, 14400.0)
    assert (soaked.until_stable.band_c, soaked.until_stable.slope_c_per_h, soaked.until_stable.hold_s) == (
        0.2,
        1.0,
        600.0,
    )
    assert isinstance(counted, Acquire)
    assert (counted.duration_s, counted.label) == (60.0, "tumble")
    assert (on.voltage_v, on.current_limit_a, on.current_a, on.output) == (15.0, 0.12, None, "on")


def test_a_step_that_mentions_no_name_of_a_loop_is_made_once(tmp_path):
    first, second = plan_of(tmp_path, steps(loop("position", "[1, 2]", "wait: 1 s"))).steps
    assert first.step is second.step


def test_expressions_stand_in_nested_values_too(tmp_path):
    stable = "{band: '${band}', slope: 1 °C/h, hold: 1 min}"
    soak = f"{{soak: unit_temperature, at_least: 5 s, until_stable: {stable}, give_up_after: 1 h}}"
    (planned,) = plan_of(tmp_path, "parameters: {band: {help: h, default: 0.2 °C}}\n" + steps(soak))
    assert planned.step.until_stable.band_c == 0.2
    assert problems_of(tmp_path, steps(soak)) == ["2:60: band: '${band}': there is no name 'band'; none is known here"]


# Loops that are wrong


@pytest.mark.parametrize(
    ("count", "problem"),
    [
        ("0", "is 0, expected a whole number of at least 1"),
        ("-1", "is -1, expected a whole number of at least 1"),
        ("1.5", "is 1.5, expected a whole number of at least 1"),
        ("2 s", "is 2 s, expected a whole number of at least 1"),
        ("often", "is often, expected a whole number of at least 1"),
        ("[1, 2]", "is 1, 2, expected a whole number of at least 1"),
        ("'${n}'", "'${n}': there is no name 'n'; none is known here"),
    ],
)
def test_steps_are_repeated_a_whole_number_of_times(tmp_path, count, problem):
    block = f"{{repeat: {count}, steps: [wait: 1 s]}}"
    assert problems_of(tmp_path, steps(block)) == [f"2:6: repeat: {problem}"]


def test_a_repetition_adds_no_name_and_a_step_in_it_is_made_once(tmp_path):
    plan = plan_of(tmp_path, steps("{repeat: 3, steps: [wait: 1 s]}"))
    assert [planned.loops for planned in plan] == [{}, {}, {}]
    assert len({id(planned.step) for planned in plan}) == 1


def test_passes_differ_in_their_ids_only(tmp_path):
    inside = (
        "{acquire: counter, label: a, during: [wait: 1 s]}, {if: '${2 > 1}', then: [wait: 1 s]}, "
        "{for_each: a, in: [1, 2], steps: [wait: '${a * \"1 s\"}']}, {repeat: 2, steps: [wait: 3 s]}"
    )
    plan = plan_of(tmp_path, steps(f"{{repeat: 3, steps: [{inside}]}}", f"{{repeat: 1, steps: [{inside}]}}"))
    ids = [planned.id for planned in plan]
    assert len(set(ids)) == len(ids) == 4 * 7
    passes = ["pass=1", "pass=2", "pass=3", "pass=1#2"]
    assert ids == [ids[index].replace("pass=1", each, 1) for each in passes for index in range(7)]
    firsts = [planned._replace(id="") for planned in plan][:7]
    assert [planned._replace(id="") for planned in plan][7:21] == [*firsts, *firsts]


def test_what_the_first_pass_measures_is_known_in_the_second(tmp_path):
    text = "{note: 'Was ${deep}.'}, {prompt: How deep?, input: {unit: m}, as: deep}"
    assert problems_of(tmp_path, steps(f"{{repeat: 2, steps: [{text}]}}")) == [
        "2:26: note: '${deep}': there is no name 'deep'; none is known here"
    ]
    known = "{prompt: How deep?, input: {unit: m}, as: deep}, {note: 'Is ${deep}.'}"
    plan = plan_of(tmp_path, steps(f"{{repeat: 3, steps: [{known}]}}"))
    assert [planned.waiting is not None for planned in plan] == [False, True] * 3


@pytest.mark.parametrize("count", [1_000_000_000, 9001])
def test_very_many_passes_are_refused_in_bounded_time_and_memory(tmp_path, count):
    (problem,) = problems_of(tmp_path, steps(f"{{repeat: {count}, steps: [wait: 1 s, wait: 2 s]}}"))
    assert problem.endswith(": the plan has more than 10000 steps")


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ("[]", "is empty, expected a list or a range with at least one value"),
        ("5", "is 5, expected a list or a range with at least one value"),
        ("'${soak}'", "is 3600 s, expected a list or a range with at least one value"),
        ("fast", "is fast, expected a list or a range with at least one value"),
        ("", "is empty, expected a value"),
        ("[1, 5 apples]", "'apples' is not a known unit"),
        ("'${temps}'", "'${temps}': there is no name 'temps'; expected offset, on or soak"),
        ("{from: 0, to: 1000000}", "a range of more than 10000 values"),
        ("{from: 0 °C, to: 90°, step: 5 °C}", "'to' of a range is 90 °, 'from' is 0 °C"),
        ("{from: 0°, to: 100°, step: 30°}", "a range from 0 ° in steps of 30 ° does not meet its end, 100 °"),
        ("{from: 0°, til: 100°}", "unknown key 'til' in a range; expected from, to, step or per_decade"),
    ],
)
def test_a_loop_runs_over_at_least_one_value(tmp_path, values, problem):
    assert problems_of(tmp_path, NAMES + steps(loop("a", values, "wait: 1 s"))) == [f"3:19: in: {problem}"]


@pytest.mark.parametrize(
    ("block", "problems"),
    [
        (loop("soak", "[1]", "wait: 1 s"), ["3:6: for_each: the name 'soak' is taken; choose another for this loop"]),
        (
            loop("a", "[1, 2]", loop("a", "[1]", "wait: 1 s")),
            ["3:40: for_each: the name 'a' is taken; choose another for this loop"],
        ),
        (
            loop("Angle", "[1]", "wait: 1 s"),
            ["3:6: for_each: is 'Angle', expected a name: at most 32 lower-case letters, digits and _, a letter first"],
        ),
    ],
)  # fmt: skip
def test_the_name_of_a_loop_is_its_own(tmp_path, block, problems):
    assert problems_of(tmp_path, NAMES + steps(block)) == problems


def test_two_loops_one_after_the_other_may_share_a_name(tmp_path):
    plan = plan_of(tmp_path, steps(loop("a", "[1]", "wait: 1 s"), loop("a", "[2]", "wait: 1 s")))
    assert ids(plan) == ["steps/a=1/wait", "steps/a=2/wait"]


def test_the_name_of_a_loop_is_gone_after_it(tmp_path):
    assert problems_of(tmp_path, steps(loop("a", "[1 s]", "wait: '${a}'"), "wait: '${a}'")) == [
        "3:5: wait: '${a}': there is no name 'a'; none is known here"
    ]


@pytest.mark.parametrize(
    ("inside", "problems"),
    [
        (["mov: head"], ["2:42: unknown step 'mov'; did you mean 'move'?"]),
        (["wait: 5"], ["2:42: wait: 5 has no unit, write it like '5 s'"]),
        (["wait: '${b}'"], ["2:42: wait: '${b}': there is no name 'b'; expected a"]),
        (["wait: '${1 / (a - 1)}'"], ["2:42: wait: '${1 / (a - 1)}': division by zero"]),
        (["{move: head, to: '${a}'}"], ["2:55: to: is a bare number, expected a quantity in °"]),
        ([loop("b", "[]", "wait: 1 s")], ["2:56: in: is empty, expected a list or a range with at least one value"]),
        (["wait: 5", "{move: head, to: '${c}'}"],
         ["2:42: wait: 5 has no unit, write it like '5 s'", "2:64: to: '${c}': there is no name 'c'; expected a"]),
        (["{move: head, to: '${c}', settle: '${d}'}"],
         ["2:55: to: '${c}': there is no name 'c'; expected a",
          "2:67: settle: '${d}': there is no name 'd'; expected a"]),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_loop_is_told_once_and_not_in_every_pass(tmp_path, inside, problems):
    assert problems_of(tmp_path, steps(loop("a", "[1, 2, 3]", *inside))) == problems


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{move: head, to: 5°, approach: '${way}'}",
         "3:26: approach: is '${way}', expected 'direct', 'from_below' or 'from_above'"),
        ("{acquire: counter, for: 5 s, label: 'a${way}'}",
         "3:34: label: is 'a${way}', expected a name: at most 32 lower-case letters, digits and _, a letter first"),
        ("{acquire: '${way}', for: 5 s, label: a}",
         "3:6: acquire: is '${way}', expected a name: at most 32 lower-case letters, digits and _, a letter first"),
        ("{'${way}': head, to: 5°}",
         "3:5: unknown step '${way}'; expected move, orient, rotate, oscillate, set, ramp, soak, wait, wait_until, "
         "acquire, measure, tare, prompt, note, alarm, custom, for_each, repeat, group, if, while, parallel, call or "
         "retry"),
        ("wait: 'x ${way}'", "3:5: wait: 'x ${way}': an expression is the whole value, like ${a + b}"),
        ("wait: '${way}'",
         "3:5: wait: 'direct' is not a quantity; if it is a parameter, write ${direct}; expected a quantity in s"),
        ("wait: '${list}'", "3:5: wait: is a list, expected a quantity in s"),
        ("wait: '${list == list}'", "3:5: wait: is true, expected a quantity in s"),
    ],
)  # fmt: skip
def test_an_expression_is_a_quantity_where_a_step_takes_one_and_nowhere_else(tmp_path, step, problem):
    names = "parameters: {way: {help: h, default: direct}, list: {help: h, default: [1 s]}}\n"
    assert problems_of(tmp_path, names + steps(step)) == [problem]


# Limits


@pytest.mark.parametrize("extra", [0, 1])
def test_a_plan_has_up_to_as_many_steps_as_the_limit(tmp_path, monkeypatch, extra):
    monkeypatch.setattr(expand, "STEP_LIMIT", 60)
    body = steps(loop("a", "{from: 1, to: 5}", loop("b", "{from: 1, to: 6}", "wait: 1 s", "wait: '${b * \"1 s\"}'")))
    if not extra:
        assert len(plan_of(tmp_path, body)) == 60
    else:
        assert problems_of(tmp_path, body + "teardown: [wait: 1 s, wait: 1 s]\n") == [
            "3:12: the plan has more than 60 steps"
        ]


def test_loops_of_very_many_steps_are_refused_in_bounded_time(tmp_path):
    body = steps(loop("a", "{from: 1, to: 10000}", loop("b", "{from: 1, to: 10000}", *["wait: 1 s"] * 200)))
    (problem,) = problems_of(tmp_path, body)
    assert problem.endswith(": the plan has more than 10000 steps")
