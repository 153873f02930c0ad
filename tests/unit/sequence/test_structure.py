"""Plans of blocks: which steps and nodes they come to, their ids, and what is told of blocks that are wrong."""

from __future__ import annotations

import pytest

from bench.config.document import read_document
from bench.sequence.language.values import in_words
from bench.sequence.plan.plan import Alternatives, Attempts, Branches, Meanwhile, Passes, PlannedStep, Section, leaves
from drivers.errors import CODES
from tests.support.sequences import TAIL, plan_of, problems_of, steps

MEASURE = "{measure: unit_temperature, as: t}"
WARM = "\"${t > '30 °C'}\""


def ids(nodes) -> list[str]:
    return [planned.id.removeprefix("steps/") for planned in leaves(nodes)]


def only(folder, *lines, after=0):
    """The one node that the last line comes to."""
    (node,) = plan_of(folder, steps(*lines)).steps[after:]
    return node


# Groups


def test_a_group_alone_adds_its_name_to_the_ids_and_nothing_else(tmp_path):
    plan = plan_of(
        tmp_path, steps("{group: a, setup: [wait: 1 s], steps: [wait: 2 s]}", "{group: a, steps: [wait: 3 s]}")
    )
    assert all(isinstance(node, PlannedStep) for node in plan.steps)
    assert ids(plan.steps) == ["a/setup/wait", "a/wait", "a#2/wait"]


def test_a_group_with_a_teardown_is_a_section_and_its_teardown_belongs_to_the_phase_teardown(tmp_path):
    inner = "{group: b, setup: [wait: 2 s], steps: [wait: 3 s], teardown: [wait: 4 s]}"
    node = only(tmp_path, f"{{group: a, setup: [wait: 1 s], steps: [{inner}], teardown: [wait: 5 s]}}")
    assert isinstance(node, Section)
    assert (node.id, node.on_failure) == ("steps/a", None)
    assert ids(node.body) == ["a/setup/wait", "a/b/setup/wait", "a/b/wait", "a/b/teardown/wait"]
    assert ids(node.teardown) == ["a/teardown/wait"]
    assert [planned.phase for planned in leaves((node,))] == ["steps", "steps", "steps", "teardown", "teardown"]
    assert isinstance(node.body[1], Section)


def test_a_group_in_the_setup_keeps_its_phase(tmp_path):
    body = "setup: [{group: a, steps: [wait: 1 s], teardown: [wait: 2 s]}]\nsteps: [wait: 1 s]\n"
    plan = plan_of(tmp_path, body)
    assert [(planned.id, planned.phase) for planned in leaves(plan.setup)] == [
        ("setup/a/wait", "setup"), ("setup/a/teardown/wait", "teardown"),
    ]  # fmt: skip


@pytest.mark.parametrize("what", ["stop", "continue", "ask"])
def test_a_group_knows_what_happens_when_it_fails(tmp_path, what):
    node = only(tmp_path, f"{{group: a, on_failure: {what}, steps: [wait: 1 s]}}")
    assert isinstance(node, Section)
    assert (node.on_failure, node.teardown) == (what, ())


def test_no_two_steps_have_one_id_whatever_groups_are_called(tmp_path):
    names = ["setup", "teardown", "then", "else", "while", "parallel", "retry", "wait", "steps"]
    groups = [f"{{group: {name}, steps: [wait: 1 s]}}" for name in names]
    inner = ", ".join(groups)
    blocks = [
        f"{{group: all, setup: [wait: 1 s], steps: [{inner}], teardown: [wait: 1 s]}}",
        MEASURE, f"{{if: {WARM}, then: [wait: 1 s], else: [wait: 1 s]}}",
        "{if: true, then: [wait: 1 s]}",
        f"{{while: {WARM}, at_most: 2, steps: [wait: 1 s]}}",
        "{parallel: {a: [wait: 1 s]}}", "{retry: 2, steps: [wait: 1 s]}",
        *groups,
    ]  # fmt: skip
    found = ids(plan_of(tmp_path, steps(*blocks, *blocks)).steps)
    assert len(found) == 2 * (len(names) + 2 + 3 + 4 + len(names))
    assert len(set(found)) == len(found)


# Conditions


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("true", ["then/wait"]),
        ("false", ["else/wait"]),
        ("'${a == 1}'", ["then/wait"]),
        ("'${a > 1}'", ["else/wait"]),
        ("'${on and not (a > 1)}'", ["then/wait"]),
    ],
)
def test_a_condition_that_is_known_before_the_run_leaves_one_way(tmp_path, condition, expected):
    names = "parameters: {a: {help: h, default: 1}, on: {help: h, default: true}}\n"
    plan = plan_of(tmp_path, names + steps(f"{{if: {condition}, then: [wait: 1 s], else: [wait: 2 s]}}"))
    assert ids(plan.steps) == expected
    assert plan.steps[0].step.duration_s == (1 if expected == ["then/wait"] else 2)


def test_a_condition_over_a_loop_is_decided_in_each_pass(tmp_path):
    block = "{for_each: a, in: [1, 2, 1], steps: [{if: '${a == 1}', then: [wait: 1 s]}, wait: 2 s]}"
    assert ids(plan_of(tmp_path, steps(block)).steps) == [
        "a=1/then/wait", "a=1/wait", "a=2/wait", "a=1#2/then/wait", "a=1#2/wait",
    ]  # fmt: skip


def test_a_measured_condition_keeps_both_ways(tmp_path):
    node = only(tmp_path, MEASURE, f"{{if: {WARM}, then: [wait: 1 s, wait: 2 s], else: [wait: 3 s]}}", after=1)
    assert isinstance(node, Alternatives)
    assert node.id == "steps/if"
    assert (ids(node.then), ids(node.otherwise)) == (["then/wait", "then/wait#2"], ["else/wait"])
    assert node.condition.raw == "${t > '30 °C'}"


def test_the_second_condition_of_a_list_is_numbered(tmp_path):
    ifs = [f"{{if: {WARM}, then: [wait: 1 s]}}", f"{{if: {WARM}, then: [wait: 1 s], else: [wait: 2 s]}}"]
    plan = plan_of(tmp_path, steps(MEASURE, *ifs))
    assert ids(plan.steps) == ["measure", "then/wait", "then#2/wait", "else#2/wait"]
    assert [node.id for node in plan.steps[1:]] == ["steps/if", "steps/if#2"]


@pytest.mark.parametrize(
    ("condition", "problem"),
    [
        ("maybe", "is maybe, expected something true or false such as ${a > '5 °C'}"),
        ("5 °C", "is 5 °C, expected something true or false such as ${a > '5 °C'}"),
        ("[true]", "is true, expected something true or false such as ${a > '5 °C'}"),
        ("\"${t + '1 °C'}\"", "is 2 °C, expected something true or false such as ${a > '5 °C'}"),
        ("\"${t > '5 V'}\"", "\"${t > '5 V'}\": cannot compare °C and V"),
        ("'${t > 5}'", "'${t > 5}': cannot compare °C and a bare number"),
        ("'${u > 5}'", "'${u > 5}': there is no name 'u'; expected t"),
    ],
)
def test_a_condition_is_true_or_false(tmp_path, condition, problem):
    (found,) = problems_of(tmp_path, steps(MEASURE, f"{{if: {condition}, then: [wait: 1 s]}}"))
    assert found.startswith("3:6: if: ")
    assert found == f"3:6: if: {problem}"


# While


def test_a_measured_loop_keeps_its_condition_its_bound_and_its_first_pass(tmp_path):
    block = f"{{while: {WARM}, at_most: '${{2 * 3}}', steps: [wait: 1 s, {MEASURE}]}}"
    node = only(tmp_path, MEASURE, block, after=1)
    assert isinstance(node, Passes)
    assert (node.id, node.at_most, node.condition.raw) == ("steps/while", 6, "${t > '30 °C'}")
    assert ids(node.body) == ["while/pass=1/wait", "while/pass=1/measure"]


def test_each_pass_of_a_loop_in_a_loop_has_its_number_in_its_ids(tmp_path):
    inner = f"{{while: {WARM}, at_most: 2, steps: [wait: 1 s, {{acquire: counter, label: a, during: [wait: 1 s]}}]}}"
    inside = f"{inner}, {{group: g, steps: [wait: 1 s], teardown: [wait: 1 s]}}, {{if: {WARM}, then: [wait: 1 s]}}"
    inside += ", {parallel: {b: [wait: 1 s]}}, {retry: 2, steps: [wait: 1 s]}"
    node = only(tmp_path, MEASURE, f"{{while: {WARM}, at_most: 3, steps: [{inside}]}}", after=1)
    second = node.numbered(2)
    assert ids(second) == [name.replace("while/pass=1/", "while/pass=2/", 1) for name in ids(node.body)]
    assert ids(second[0].numbered(5))[0] == "while/pass=2/while/pass=5/wait"
    assert [getattr(each, "id", None) for each in second] == [
        "steps/while/pass=2/while", "steps/while/pass=2/g", "steps/while/pass=2/if", "steps/while/pass=2/parallel",
        "steps/while/pass=2/retry",
    ]  # fmt: skip
    assert node.numbered(1) == node.body


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ("while: true, at_most: 2", "while: does not depend on a measurement, so it never changes; use repeat, or if"),
        ("while: '${1 > 2}', at_most: 2",
         "while: does not depend on a measurement, so it never changes; use repeat, or if"),
        (f"while: {WARM}, at_most: 0", "at_most: is 0, expected a whole number of at least 1"),
        (f"while: {WARM}, at_most: 1.5", "at_most: is 1.5, expected a whole number of at least 1"),
        (f"while: {WARM}, at_most: 2 s", "at_most: is 2 s, expected a whole number of at least 1"),
        (f"while: {WARM}, at_most: '${{t}}'", "at_most: depends on a measurement; use while, which has a condition"),
        ("while: '${t}', at_most: 2", "while: is 1 °C, expected something true or false such as ${a > '5 °C'}"),
    ],
)  # fmt: skip
def test_a_measured_loop_ends(tmp_path, keys, problem):
    (found,) = problems_of(tmp_path, steps(MEASURE, f"{{{keys}, steps: [wait: 1 s]}}"))
    assert found.partition(": ")[2] == problem


def test_what_only_the_loop_measures_its_condition_cannot_ask_before_the_first_pass(tmp_path):
    (found,) = problems_of(tmp_path, steps(f"{{while: {WARM}, at_most: 2, steps: [{MEASURE}]}}"))
    assert found == "2:6: while: \"${t > '30 °C'}\": there is no name 't'; none is known here"


# Parallel, retry, during


def test_branches_are_kept_apart_by_their_names(tmp_path):
    node = only(
        tmp_path, "{parallel: {heat: [{ramp: chamber, to: 20 °C, at: 1 °C/min}], turn: [wait: 1 s, wait: 2 s]}}"
    )
    assert isinstance(node, Branches)
    assert {name: ids(branch) for name, branch in node.branches.items()} == {
        "heat": ["parallel/heat/ramp"], "turn": ["parallel/turn/wait", "parallel/turn/wait#2"],
    }  # fmt: skip


def test_attempts_have_a_number_a_delay_and_codes_of_errors(tmp_path):
    node = only(tmp_path, "{retry: 3, delay: 10 s, on: [silent, step], steps: [wait: 1 s]}")
    assert isinstance(node, Attempts)
    assert (node.id, node.at_most, node.delay_s, node.on) == ("steps/retry", 3, 10.0, ("silent", "step"))
    assert ids(node.body) == ["retry/wait"]


def test_attempts_follow_any_error_of_a_device_unless_the_sequence_says_which(tmp_path):
    node = only(tmp_path, "{retry: 2, steps: [wait: 1 s]}")
    assert (node.delay_s, node.on) == (0.0, CODES)


def test_the_delay_between_attempts_may_be_an_expression(tmp_path):
    names = "parameters: {pause: {help: h, default: 5 s}}\n"
    plan = plan_of(tmp_path, names + steps("{retry: 2, delay: '${2 * pause}', steps: [wait: 1 s]}"))
    assert plan.steps[0].delay_s == 10.0


@pytest.mark.parametrize(
    ("delay", "problem"),
    [
        ("'${pause}'", "delay: '${pause}': there is no name 'pause'; expected t"),
        ("'${t}'", "delay: depends on a measurement; it must be known before the run"),
        ("\"${'1 V'}\"", "delay: is in V, expected a quantity in s"),
        ("\"${'0 s' - '1 s'}\"", "delay: is -1 s, expected at least 0 s"),
    ],
)
def test_a_delay_is_a_time_that_is_known_before_the_run(tmp_path, delay, problem):
    (found,) = problems_of(tmp_path, steps(MEASURE, f"{{retry: 2, delay: {delay}, steps: [wait: 1 s]}}"))
    assert found == f"3:16: {problem}"


def test_a_step_with_others_inside_lasts_as_long_as_they_do(tmp_path):
    node = only(tmp_path, "{acquire: counter, label: a, during: [wait: 1 s, {group: g, steps: [wait: 2 s]}]}")
    assert isinstance(node, Meanwhile)
    assert (node.step.id, node.step.step.label) == ("steps/acquire", "a")
    assert ids(node.body) == ["acquire/wait", "acquire/g/wait"]
    assert ids((node,)) == ["acquire", "acquire/wait", "acquire/g/wait"]


def test_what_is_wrong_inside_is_told_once_at_its_own_place(tmp_path):
    block = "{acquire: counter, label: a, during: [wait: 5, {move: head, to: '${b}'}]}"
    assert problems_of(tmp_path, steps(f"{{repeat: 3, steps: [{block}]}}")) == [
        "2:63: wait: 5 has no unit, write it like '5 s'",
        "2:85: to: '${b}': there is no name 'b'; none is known here",
    ]


# Product loops


def test_a_product_of_lists_is_the_same_as_loops_inside_loops(tmp_path):
    inside = "{move: head, to: '${a}'}, {ramp: chamber, to: '${b}', at: 1 °C/min}"
    product = f"{{for_each: {{b: [20 °C, 30 °C, 20 °C], a: {{from: 0°, to: 90°, step: 45°}}}}, steps: [{inside}]}}"
    nested = (
        "{for_each: b, in: [20 °C, 30 °C, 20 °C], steps: "
        f"[{{for_each: a, in: {{from: 0°, to: 90°, step: 45°}}, steps: [{inside}]}}]}}"
    )
    one, other = (plan_of(tmp_path, steps(block)).steps for block in (product, nested))
    assert ids(one) == ids(other)
    assert [planned.step for planned in one] == [planned.step for planned in other]
    assert [planned.loops for planned in one] == [planned.loops for planned in other]
    assert len(one) == 2 * 9


@pytest.mark.parametrize(
    ("lists", "problem"),
    [
        ("{a: [1], b: []}", "for_each: is empty, expected a list or a range with at least one value"),
        ("{a: 5}", "for_each: is 5, expected a list or a range with at least one value"),
        ("{a: [1], t: [2]}", "for_each: the name 't' is taken; choose another for this loop"),
        ("{a: ['${t}']}", "for_each: depends on a measurement; the values of a loop must be known before the run"),
        ("{}", "for_each: is empty, expected a name, or names with their values"),
        ("{A: [1]}", "for_each: is 'A', expected a name: at most 32 lower-case letters, digits and _, a letter first"),
    ],
)
def test_a_product_goes_through_lists_under_names_of_their_own(tmp_path, lists, problem):
    (found,) = problems_of(tmp_path, steps(MEASURE, f"{{for_each: {lists}, steps: [wait: 1 s]}}"))
    assert found == f"3:6: {problem}"


# Measurements in expressions


def test_a_step_over_a_measurement_waits_with_what_is_known_of_it(tmp_path):
    block = "{for_each: a, in: [2], steps: [{wait_until: unit_temperature, above: '${t * a}', give_up_after: 1 h}]}"
    _, planned = plan_of(tmp_path, steps(MEASURE, block)).steps
    assert planned.waiting.raw["above"] == "${t * a}"
    assert {name: in_words(value) for name, value in planned.waiting.names.items()} == {"a": "2"}


def test_a_step_that_could_be_worked_out_does_not_wait(tmp_path):
    _, planned = plan_of(
        tmp_path, "parameters: {a: {help: h, default: 2 s}}\n" + steps(MEASURE, "wait: '${2 * a}'")
    ).steps
    assert (planned.waiting, planned.step.duration_s) == (None, 4.0)


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("{move: head, to: '${t}'}", "18: to: is in °C, expected a quantity in °"),
        ("wait: \"${t / '1 s'}\"", "5: wait: is in °C/min, expected a quantity in s"),
        ("{ramp: chamber, to: '${t * 2}', at: \"${t / '1 V'}\"}",
         "37: at: is in s^3·A·°C/m^2/kg, expected a quantity in °C/min"),
        ("note: \"${t + '1 V'}\"", "5: note: \"${t + '1 V'}\": cannot add °C and V"),
        ("{wait_until: unit_temperature, above: \"${t * '1 V'}\", give_up_after: 1 h}",
         "36: above: is in m^2·kg·°C/s^3/A, expected a quantity in °C"),
        ("{measure: unit_temperature, limits: {min: '${t * t}'}}", "42: min: is in °C^2, expected a quantity in °C"),
    ],
)  # fmt: skip
def test_a_measurement_of_another_dimension_is_told_before_the_run(tmp_path, line, problem):
    found = problems_of(tmp_path, steps(MEASURE, line))
    assert len(found) == 1
    assert found[0] == f"3:{problem}"


def test_without_a_bench_the_unit_of_a_measurement_is_not_known_and_nothing_is_told_of_it(tmp_path):
    body = steps(MEASURE, "{move: head, to: '${t}'}", f"{{if: {WARM}, then: [wait: 1 s]}}", "note: It is ${t}.")
    assert len(plan_of(tmp_path, body, bench=None)) == 4


def test_a_name_is_known_after_it_is_measured_and_not_before(tmp_path):
    assert problems_of(tmp_path, steps("wait: '${t}'", MEASURE)) == [
        "2:5: wait: '${t}': there is no name 't'; none is known here"
    ]
    names = "{prompt: How many?, input: {unit: '', min: 1}, as: n}"
    plan = plan_of(tmp_path, steps(names, "wait: \"${n * '1 s'}\""))
    assert plan.steps[1].waiting is not None


@pytest.mark.parametrize(
    ("names", "lines", "problem"),
    [
        ("parameters: {t: {help: h, default: 1 s}}\n", ("wait: '${t}'", MEASURE),
         "4:33: as: the name 't' is taken; choose another"),
        ("", (f"{{for_each: t, in: [1], steps: [{MEASURE}]}}",), "2:64: as: the name 't' is taken; choose another"),
        ("", (MEASURE, "{for_each: t, in: [1], steps: [wait: 1 s]}"),
         "3:6: for_each: the name 't' is taken; choose another for this loop"),
        ("", ("{for_each: t, in: [1], steps: [{prompt: Ready?, as: t}]}",),
         "2:53: as: the name 't' is taken; choose another"),
    ],
)  # fmt: skip
def test_a_name_means_one_thing(tmp_path, names, lines, problem):
    assert problems_of(tmp_path, names + steps(*lines)) == [problem]


def test_a_measurement_may_be_taken_again_under_its_name(tmp_path):
    assert len(plan_of(tmp_path, steps(MEASURE, MEASURE, f"{{if: {WARM}, then: [wait: 1 s]}}"))) == 3


# Texts


@pytest.mark.parametrize("verb", ["note", "alarm", "prompt"])
def test_texts_are_filled_with_what_is_known(tmp_path, verb):
    names = "parameters: {a: {help: h, default: 20 °C}, on: {help: h, default: true}}\n"
    body = names + steps(f"{verb}: 'At ${{a}}, ${{a + a}}: ${{on}}.'")
    (planned,) = plan_of(tmp_path, body).steps
    assert planned.step.text == "At 20 °C, 40 °C: true."


def test_a_text_over_a_measurement_waits_for_it(tmp_path):
    _, planned = plan_of(tmp_path, steps(MEASURE, "note: 'It is ${t}.'")).steps
    assert planned.waiting.raw["note"] == "It is ${t}."


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a ${b} c", "'${b}': there is no name 'b'; none is known here"),
        ("a ${b c", "'a ${b c': an expression in a text begins with ${ and ends with }"),
        ("a ${1} ${", "'a ${1} ${': an expression in a text begins with ${ and ends with }"),
        ("a ${} c", "'${}': is not an expression; expected numbers, names"),
    ],
)
def test_a_text_with_a_wrong_expression_is_told(tmp_path, text, problem):
    (found,) = problems_of(tmp_path, steps(f"note: '{text}'"))
    assert found.startswith(f"2:5: note: {problem}")


# Calls

CALLED = """\
schema: itb-sequence/1
title: Called
needs: {head: positioner, unit_temperature: thermometer}
parameters: {angle: {help: h, default: 90°, min: 0°, max: 180°}, pause: {help: h, default: 5 s}}
setup: [wait: 1 s]
steps:
  - {move: head, to: '${angle}'}
  - wait: ${pause}
teardown: [{move: head, to: 0°}]
"""


def called(folder, text=CALLED, name="turn"):
    (folder / f"{name}.yaml").write_text(text, "utf-8")


def test_a_called_sequence_is_done_with_the_parameters_that_it_is_given(tmp_path):
    called(tmp_path)
    node = only(tmp_path, "{for_each: a, in: [2], steps: [{call: turn.yaml, with: {angle: \"${a * '10°'}\"}}]}")
    assert isinstance(node, Section)
    assert (node.id, node.on_failure) == ("steps/a=2/turn", None)
    assert ids(node.body) == ["a=2/turn/setup/wait", "a=2/turn/move", "a=2/turn/wait"]
    assert ids(node.teardown) == ["a=2/turn/teardown/move"]
    assert (node.body[1].step.to_deg, node.body[2].step.duration_s) == (20.0, 5.0)


def test_a_sequence_that_is_called_twice_has_ids_of_its_own(tmp_path):
    called(tmp_path)
    plan = plan_of(tmp_path, steps("call: turn.yaml", "{call: turn.yaml, with: {angle: 5°}}"))
    assert ids(plan.steps)[1::4] == ["turn/move", "turn#2/move"]
    assert [section.body[1].step.to_deg for section in plan.steps] == [90.0, 5.0]


def test_a_called_sequence_does_not_see_the_loops_and_parameters_of_its_caller(tmp_path):
    called(tmp_path, CALLED.replace("${pause}", "${p}"))
    names = "parameters: {p: {help: h, default: 7 s}}\n"
    (found,) = problems_of(tmp_path, names + steps("wait: '${p}'", "call: turn.yaml"))
    assert found == f"{tmp_path / 'turn.yaml'}:8:5: wait: '${{p}}': there is no name 'p'; expected angle or pause"


def test_a_parameter_of_a_called_sequence_is_meant_though_its_caller_has_measured_something_of_that_name(tmp_path):
    called(tmp_path)
    measured = "{measure: unit_temperature, as: pause}"
    plan = plan_of(tmp_path, steps(measured, "call: turn.yaml"))
    step = plan.steps[1].body[2]
    assert (step.waiting, step.step.duration_s) == (None, 5.0)


def test_a_parameter_is_meant_though_what_it_calls_measures_something_of_that_name(tmp_path):
    called(tmp_path, CALLED.replace("wait: 1 s", "{measure: unit_temperature, as: p}"))
    names = "parameters: {p: {help: h, default: 7 s}}\n"
    plan = plan_of(tmp_path, names + steps("call: turn.yaml", "wait: '${p}'"))
    assert (plan.steps[1].waiting, plan.steps[1].step.duration_s) == (None, 7.0)


def test_what_a_called_sequence_measures_is_known_after_it(tmp_path):
    called(tmp_path, CALLED.replace("wait: 1 s", MEASURE[1:-1].join("{}")))
    plan = plan_of(tmp_path, steps("call: turn.yaml", "note: 'It was ${t}.'"))
    assert plan.steps[1].waiting is not None


def test_needs_of_a_called_sequence_are_needs_of_the_whole(tmp_path):
    called(tmp_path)
    tail = TAIL.replace("  head: positioner\n", "")
    plan = plan_of(tmp_path, steps("call: turn.yaml"), tail=tail)
    assert plan.sequence.needs["head"] == "positioner"
    assert plan.document.value["needs"].get("head") is None


def test_a_need_that_a_bench_lacks_is_told_where_it_is_declared(tmp_path):
    called(tmp_path, CALLED.replace("head: positioner", "head: positioner, table: rate_table"))
    (found,) = problems_of(tmp_path, steps("call: turn.yaml"))
    assert found.startswith(
        f"{tmp_path / 'turn.yaml'}:3:27: the bench 'Simulated accelerometer bench' has no device 'table'"
    )


def test_sequences_of_one_run_agree_on_what_they_need(tmp_path):
    called(tmp_path, CALLED.replace("head: positioner", "head: rate_table"))
    assert problems_of(tmp_path, steps("{move: head, to: 0°}", "call: turn.yaml")) == [
        "3:5: call: it needs 'head' as a rate_table, another called sequence as a positioner"
    ]


def test_interlocks_of_a_called_sequence_hold_for_the_whole_run(tmp_path):
    hot = "interlocks: {hot: {reading: unit_temperature, above: 85 °C, then: stop}}\n"
    called(tmp_path, CALLED + hot)
    assert list(plan_of(tmp_path, steps("call: turn.yaml", "call: turn.yaml")).sequence.interlocks) == ["hot"]
    colder = hot.replace("85", "80")
    assert problems_of(tmp_path, colder + steps("call: turn.yaml")) == [
        "3:5: call: its interlock 'hot' differs from that of the calling sequence"
    ]
    called(tmp_path, CALLED + hot.replace("85 °C", "85 V"))
    (found,) = problems_of(tmp_path, steps("call: turn.yaml"))
    assert found.startswith(f"{tmp_path / 'turn.yaml'}:10:")


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("call: gone.yaml", "2:5: call: {folder}/gone.yaml: there is no such file"),
        ("call: s.yaml", "2:5: call: s.yaml calls s.yaml: a sequence cannot call itself"),
        ("{call: turn.yaml, with: {anglee: 5°}}", "2:30: there is no parameter 'anglee'; did you mean 'angle'?"),
        ("{call: turn.yaml, with: {angle: 5 s}}", "2:30: 'angle' is 5 s, expected a quantity in °"),
        ("{call: turn.yaml, with: {angle: 190°}}", "2:30: 'angle' is 190 °, expected at most 180 °"),
        ("{call: turn.yaml, with: {angle: [5°]}}", "2:30: 'angle' is a list, expected one value"),
        ("{call: turn.yaml, with: {angle: '${b}'}}", "2:30: angle: '${{b}}': there is no name 'b'; none is known here"),
    ],
)
def test_a_call_that_cannot_be_made_is_told(tmp_path, line, problem):
    called(tmp_path)
    assert problems_of(tmp_path, steps(line)) == [problem.format(folder=tmp_path)]


def test_what_is_given_to_a_called_sequence_is_known_before_the_run(tmp_path):
    called(tmp_path)
    measured = "{prompt: How far?, input: {unit: °}, as: far}"
    assert problems_of(tmp_path, steps(measured, "{call: turn.yaml, with: {angle: '${far}'}}")) == [
        "3:30: 'angle' depends on a measurement; the parameters of a called sequence must be known before the run"
    ]


def test_a_mistake_in_a_called_sequence_is_told_at_its_own_place_and_once(tmp_path):
    called(tmp_path, CALLED.replace("to: '${angle}'", "to: 400°").replace("wait: 1 s", "wait: 1"))
    block = "{repeat: 3, steps: [call: turn.yaml]}"
    assert problems_of(tmp_path, steps(block, "call: turn.yaml", "wait: 5")) == [
        "4:5: wait: 5 has no unit, write it like '5 s'",
        f"{tmp_path / 'turn.yaml'}:5:9: wait: 1 has no unit, write it like '1 s'",
        f"{tmp_path / 'turn.yaml'}:7:18: to: 400 ° is above the 365 ° that the bench file allows 'head' "
        "(step steps/pass=1/turn/move)",
    ]


def test_a_called_sequence_that_cannot_be_read_is_told_with_its_first_problem(tmp_path):
    called(tmp_path, "steps: [wait: 1 s]\n")
    assert problems_of(tmp_path, steps("call: turn.yaml")) == [
        f"2:5: call: {tmp_path / 'turn.yaml'}:1:1: the key 'needs' is missing (and 2 more)"
    ]


def test_called_sequences_call_others_beside_them(tmp_path):
    called(tmp_path, CALLED.replace("wait: ${pause}", "call: rest.yaml"))
    called(tmp_path, "schema: itb-sequence/1\ntitle: R\nneeds: {}\nsteps: [wait: 8]\n", "rest")
    assert problems_of(tmp_path, steps("call: turn.yaml")) == [
        f"{tmp_path / 'rest.yaml'}:4:9: wait: 8 has no unit, write it like '8 s'"
    ]
    called(tmp_path, "schema: itb-sequence/1\ntitle: R\nneeds: {}\nsteps: [wait: 8 s]\n", "rest")
    plan = plan_of(tmp_path, steps("call: turn.yaml"))
    assert ids(plan.steps) == ["turn/setup/wait", "turn/move", "turn/rest/wait", "turn/teardown/move"]
    place = plan.steps[0].body[2].place
    assert plan.where(place) == f"{tmp_path / 'rest.yaml'}:4:9"


def test_sequences_that_call_one_another_in_a_circle_are_told(tmp_path):
    called(tmp_path, CALLED.replace("wait: ${pause}", "call: back.yaml"))
    called(tmp_path, "schema: itb-sequence/1\ntitle: R\nneeds: {}\nsteps: [call: turn.yaml]\n", "back")
    assert problems_of(tmp_path, steps("call: turn.yaml")) == [
        f"{tmp_path / 'back.yaml'}:4:9: call: turn.yaml calls back.yaml calls turn.yaml: a sequence cannot call itself"
    ]


def test_sequences_call_one_another_in_bounded_depth(tmp_path):
    for number in range(10):
        text = f"schema: itb-sequence/1\ntitle: R\nneeds: {{}}\nsteps: [call: a{number + 1}.yaml]\n"
        called(tmp_path, text, f"a{number}")
    (found,) = problems_of(tmp_path, steps("call: a0.yaml"))
    assert found.endswith(":4:9: call: sequences call one another more than 8 deep")


def test_a_sequence_that_is_called_in_a_long_loop_is_read_once(tmp_path, monkeypatch):
    called(tmp_path)
    read = []
    monkeypatch.setattr(
        "bench.sequence.plan.subsequences.read_document",
        lambda path, real=read_document: read.append(path) or real(path),
    )
    plan = plan_of(tmp_path, steps("{repeat: 500, steps: [call: turn.yaml]}"))
    assert len(plan) == 2000
    assert read == [tmp_path / "turn.yaml"]
