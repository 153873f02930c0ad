"""Sequence files: what a step, a parameter and a preset may say, the choices of a run, and every problem at once."""

from __future__ import annotations

import json
from copy import deepcopy

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.errors import InputError
from bench.sequence.language.values import in_words
from bench.sequence.load import load_sequence
from bench.sequence.method import known_methods
from bench.sequence.plan import expand
from bench.sequence.plan.plan import Plan
from drivers.schema.suggest import did_you_mean
from tests.support.sequences import BENCH, ROOT, TAIL, load_plan, plan_of, problems_of, steps

NAME = "expected a name: at most 32 lower-case letters, digits and _, a letter first"
KINDS = (
    "move, orient, rotate, oscillate, set, ramp, soak, wait, wait_until, acquire, measure, tare, prompt, note, alarm, "
    "custom, for_each, repeat, group, if, while, parallel, call or retry"
)
WAIT = "steps: [wait: 1 s]\n"


def chosen(plan: Plan) -> dict[str, str]:
    return {name: in_words(value) for name, value in plan.parameters.items()}


# Steps


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("mov: head", "2:5: unknown step 'mov'; did you mean 'move'?"),
        ("{to: 5°, move: head}", "2:5: the first key of a step is its verb: put 'move' before 'to'"),
        ("{to: 5°}", f"2:5: unknown step 'to'; expected {KINDS}"),
        ("{}", "2:5: is empty, expected a step: a mapping whose first key is its verb"),
        ("move", "2:5: is 'move', expected a step: a mapping whose first key is its verb"),
        ("", "2:4: is empty, expected a step: a mapping whose first key is its verb"),
        ("[wait: 1 s]", "2:5: is a list, expected a step: a mapping whose first key is its verb"),
    ],
)
def test_a_step_begins_with_its_verb(tmp_path, step, problem):
    assert problems_of(tmp_path, steps(step)) == [problem]


@pytest.mark.parametrize(
    ("step", "problems"),
    [
        ("{move: head, too: 5°}", ["2:18: too: unknown key; did you mean 'to'?"]),
        ("{move: head, to: 5°, aproach: direct}", ["2:26: aproach: unknown key; did you mean 'approach'?"]),
        ("{move: head}", ["2:5: a move needs one of to and by, it has none of them"]),
        ("{ramp: chamber}", ["2:5: the key 'at' is missing", "2:5: the key 'to' is missing"]),
        ("{set: supply}", ["2:5: the key 'output' is missing"]),
        ("{for_each: a, steps: [wait: 1 s]}", ["2:5: the key 'in' is missing"]),
        ("{for_each: a, in: [1]}", ["2:5: the key 'steps' is missing"]),
        ("{for_each: a, in: [1], stps: [wait: 1 s]}", ["2:28: stps: unknown key; did you mean 'steps'?"]),
        (
            "{soak: unit_temperature, at_least: 5 s, give_up_after: 1 h, until_stable: {band: 0 °C, slop: 1 °C/h}}",
            [
                "2:65: the key 'hold' is missing",
                "2:80: band: is 0 °C, expected more than 0 °C",
                "2:92: slop: unknown key; did you mean 'slope'?",
            ],
        ),
    ],
)
def test_a_misspelt_key_is_told_with_the_right_one_and_a_missing_one_by_its_name(tmp_path, step, problems):
    assert problems_of(tmp_path, steps(step)) == problems


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{move: head, to: 5 °C}", "2:18: to: is in °C, expected a quantity in °"),
        ("{move: head, to: 5}", "2:18: to: 5 has no unit, write it like '5 °'"),
        ("{move: head, to: 5°, approach: below}",
         "2:26: approach: is 'below', expected 'direct', 'from_below' or 'from_above'"),
        ("wait: 5", "2:5: wait: 5 has no unit, write it like '5 s'"),
        ("wait: -5 s", "2:5: wait: is -5 s, expected at least 0 s"),
        ("wait: 5 K", "2:5: wait: kelvin is refused: write °C, for a difference too; expected a quantity in s"),
        ("wait: [1 s]", "2:5: wait: is a list, expected a quantity in s"),
        ("{ramp: chamber, to: 20 °C, at: 1 °C}", "2:32: at: is in °C, expected a quantity in °C/min"),
        ("{ramp: chamber, to: 20 °C, at: 0 °C/min}", "2:32: at: is 0 °C/min, expected more than 0 °C/min"),
        ("{acquire: counter, for: 0 s, label: a}", "2:24: for: is 0 s, expected more than 0 s"),
        ("{acquire: counter, for: 5 s, label: Tumble One}", f"2:34: label: is 'Tumble One', {NAME}"),
        ("{acquire: counter, for: 5 s, label: 5}", "2:34: label: is 5, expected text; put it in quotes"),
        ("{move: Head, to: 5°}", f"2:6: move: is 'Head', {NAME}"),
        ("{set: supply, output: true}", "2:19: output: is true, expected 'on' or 'off'"),
        ("{soak: unit_temperature, at_least: 5 s, until_stable: 5}", "2:45: until_stable: is 5, expected a mapping"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_told_with_what_was_expected(tmp_path, step, problem):
    assert problems_of(tmp_path, steps(step)) == [problem]


ON_NEEDS = "2:5: switching on needs voltage and current_limit, or current and compliance"
NOT_BOTH = "2:5: give voltage and current_limit, or current and compliance, not both"


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{set: supply, output: on}", ON_NEEDS),
        ("{set: supply, output: on, voltage: 5 V}", ON_NEEDS),
        ("{set: source, output: on, compliance: 5 V}", ON_NEEDS),
        ("{set: supply, output: on, voltage: 5 V, current: 1 mA}", ON_NEEDS),
        ("{set: supply, output: on, voltage: 5 V, current_limit: 9 mA, current: 1 mA}", NOT_BOTH),
        ("{set: supply, output: off, voltage: 0 V}", "2:5: with 'output: off' there is no level to set"),
        (
            "{soak: unit_temperature, at_least: 5 s, until_stable: {band: 1 °C, slope: 1 °C/h, hold: 1 min}}",
            "2:5: 'until_stable' needs 'give_up_after', a limit of the waiting time",
        ),
        ("{wait_until: unit_temperature, give_up_after: 1 h}", "2:5: needs above, or below, or both; or steady"),
        ("{wait_until: unit_temperature, above: 5 °C}", "2:5: the key 'give_up_after' is missing"),
        (
            "{wait_until: unit_temperature, above: 5 °C, below: 5 °C, give_up_after: 1 h}",
            "2:5: nothing is above 5 °C and below 5 °C",
        ),
        (
            "{wait_until: unit_temperature, above: 5 °C, hold: 1 h, give_up_after: 60 min}",
            "2:5: 'give_up_after' must be longer than 'hold'",
        ),
        ("{wait: 5 s, timeout: 5 s}", "2:5: its timeout of 5 s is over before the 5 s that it takes"),
        (
            "{acquire: counter, for: 5 s, label: a, timeout: 4 s}",
            "2:5: its timeout of 4 s is over before the 5 s that it takes",
        ),
        ("{move: head, to: 5°, timeout: 0 s}", "2:26: timeout: is 0 s, expected more than 0 s"),
        ("{note: ''}", "2:6: note: is empty, expected text"),
        ("{repeat: 2, steps: []}", "2:17: steps: is empty, expected at least one"),
        (
            "{group: 2 a, steps: [wait: 1 s]}",
            "2:6: group: is '2 a', expected a name: at most 32 lower-case letters, digits and _, a letter first",
        ),
    ],
)
def test_keys_that_belong_together_are_given_together(tmp_path, step, problem):
    assert problems_of(tmp_path, steps(step)) == [problem]


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ("steps:\n", "1:1: steps: is empty, expected a list"),
        ("steps: []\n", "1:1: steps: is empty, expected at least one"),
        ("steps: all\n", "1:1: steps: is 'all', expected a list"),
        ("steps: {wait: 1 s}\n", "1:1: steps: is a mapping, expected a list"),
        ("setup: [wait: 1 s]\n", "1:1: the key 'steps' is missing"),
        (WAIT + "setup: 5\n", "2:1: setup: is 5, expected a list"),
        (WAIT + "teardown:\n", "2:1: teardown: is empty, expected a list"),
        (WAIT + "teardwn: []\n", "2:1: teardwn: unknown key; did you mean 'teardown'?"),
    ],
)
def test_steps_stand_in_lists(tmp_path, body, problem):
    assert problems_of(tmp_path, body) == [problem]


@pytest.mark.parametrize(
    ("tail", "problem"),
    [
        ("title: T\nneeds: {}\n", "1:1: the key 'schema' is missing"),
        ("schema: itb-bench/1\ntitle: T\nneeds: {}\n", "2:1: schema: is 'itb-bench/1', expected 'itb-sequence/1'"),
        ("schema: itb-sequence/1\nneeds: {}\n", "1:1: the key 'title' is missing"),
        ("schema: itb-sequence/1\ntitle: ''\nneeds: {}\n", "3:1: title: is empty, expected text"),
        ("schema: itb-sequence/1\ntitle: T\nneed: {}\n", "4:1: need: unknown key; did you mean 'needs'?"),
        ("schema: itb-sequence/1\ntitle: T\nneeds:\n", "4:1: needs: is empty, expected a mapping"),
        ("schema: itb-sequence/1\ntitle: T\nneeds: {Head: positioner}\n", f"4:9: Head: is 'Head', {NAME}"),
        (
            "schema: itb-sequence/1\ntitle: T\nneeds: {chamber: thermal_chmber}\n",
            "4:9: chamber: there is no kind of device 'thermal_chmber'; did you mean 'thermal_chamber'?",
        ),
        (
            "schema: itb-sequence/1\ntitle: T\nneeds: {arm: robot}\n",
            "4:9: arm: there is no kind of device 'robot'; expected positioner, rate_table, power_supply, "
            "current_source, thermal_chamber, thermometer, pulse_counter, voltmeter, telemetry, output or reading",
        ),
    ],
)
def test_the_head_of_a_sequence_is_complete(tmp_path, tail, problem):
    assert problems_of(tmp_path, WAIT, tail=tail) == [problem]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "1:1: is empty, expected a mapping"),
        ("- wait: 1 s\n", "1:1: is a list, expected a mapping"),
        ("hello\n", "1:1: is 'hello', expected a mapping"),
        ("steps: [wait: 1 s\n", "1:8: is not YAML: a comma is missing here, or a bracket is not closed"),
        ("steps: []\nsteps: []\n", "2:1: the key 'steps' stands twice; it is already in line 1"),
    ],
)
def test_a_file_that_is_no_mapping_is_refused(tmp_path, text, problem):
    assert problems_of(tmp_path, text, tail="") == [problem]


def test_a_sequence_is_read_with_its_expressions_unevaluated():
    document, sequence = load_sequence(ROOT / "sequences/tumble_static.yaml")
    assert sequence.title == "Static temperature tumble"
    assert next(iter(sequence.presets)) == "quick"
    assert document.value["steps"][0]["in"] == {"from": 1, "to": "${cycles}"}


def test_an_expression_of_no_known_name_is_found_only_when_it_is_worked_out(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(steps("wait: ${gate}") + TAIL, "utf-8")
    assert len(load_sequence(path)[1].steps) == 1
    assert problems_of(tmp_path, steps("wait: ${gate}")) == [
        "2:5: wait: '${gate}': there is no name 'gate'; none is known here"
    ]


# Parameters


@pytest.mark.parametrize(
    ("parameter", "problem"),
    [
        ("{help: h}", "3:3: the key 'default' is missing"),
        ("{default: 1}", "3:3: the key 'help' is missing"),
        ("{help: '', default: 1}", "3:7: help: is empty, expected text"),
        ("{help: 5, default: 1}", "3:7: help: is 5, expected text; put it in quotes"),
        ("{help: h, default: 5 V, mn: 3 V}", "3:30: mn: unknown key; did you mean 'min'?"),
        ("5", "3:3: p: is 5, expected a mapping"),
        ("{help: h, default: }", "3:16: default: is empty, expected a value"),
        ("{help: h, default: []}", "3:3: p: the default is an empty list, from which no unit follows"),
        ("{help: h, default: 5 apples}", "3:16: default: 'apples' is not a known unit"),
        ("{help: h, default: .nan}", "3:16: default: '.nan' is not a quantity"),
        ("{help: h, default: 1_000}",
         "3:16: default: '1_000' is not a quantity; write 1500 or 1.5, nothing between the digits"),
        ("{help: h, default: '${q}'}", "3:16: default: '${q}': there is no name 'q'; none is known here"),
        ("{help: h, default: [1 V, 2 A]}", "3:3: p: the default is 2 A, expected a quantity in V"),
        ("{help: h, default: [1, 2 A]}", "3:3: p: the default is 2 A, expected a number without a unit"),
        ("{help: h, default: [1 V, a]}", "3:3: p: the default is 'a', expected a value like 1 V"),
        ("{help: h, default: 5 V, min: 1 A}", "3:3: p: min is 1 A, the default is 5 V"),
        ("{help: h, default: 5 V, max: 1}", "3:3: p: max is 1, the default is 5 V"),
        ("{help: h, default: fast, min: 1}", "3:3: p: min is 1, the default is fast"),
        ("{help: h, default: 5 V, min: fast}", "3:30: min: is 'fast', expected a quantity"),
        ("{help: h, default: 5 V, max: [1 V]}", "3:30: max: is a list, expected a quantity"),
        ("{help: h, default: 5 V, min: 1 K}", "3:30: min: kelvin is refused: write °C, for a difference too"),
        ("{help: h, default: 5 V, min: 6 V, max: 4 V}", "3:3: p: min is above max"),
        ("{help: h, default: 5 V, min: 6 V}", "3:3: p: the default is 5 V, expected at least 6 V"),
        ("{help: h, default: [5 V, 9 V], max: 8 V}", "3:3: p: the default is 9 V, expected at most 8 V"),
    ],
)  # fmt: skip
def test_a_parameter_fits_together(tmp_path, parameter, problem):
    assert problems_of(tmp_path, f"{WAIT}parameters:\n  p: {parameter}\n") == [problem]


def test_a_parameter_has_a_name(tmp_path):
    assert problems_of(tmp_path, f"{WAIT}parameters: {{Gate: {{help: h, default: 1}}}}\n") == [
        f"2:14: Gate: is 'Gate', {NAME}"
    ]


CHOICES = (
    WAIT
    + """\
parameters:
  angle: {help: h, default: 10°, min: 0°, max: 90°}
  temperatures: {help: h, default: [20 °C, 30 °C]}
  n: {help: h, default: 2}
  mode: {help: h, default: direct}
  flag: {help: h, default: true}
presets:
  warm: {help: h, set: {temperatures: [40 °C, {from: 50 °C, to: 60 °C, step: 5 °C}], n: 3}}
"""
)
DEFAULTS = {"angle": "10 °", "temperatures": "20 °C, 30 °C", "n": "2", "mode": "direct", "flag": "true"}
WARM = {"temperatures": "40 °C, 50 °C, 55 °C, 60 °C", "n": "3"}


@pytest.mark.parametrize(
    ("preset", "options", "changed"),
    [
        (None, (), {}),
        ("warm", (), WARM),
        (None, ("n=5",), {"n": "5"}),
        (None, (" n = 5 ",), {"n": "5"}),
        ("warm", ("n=5",), WARM | {"n": "5"}),
        (None, ("angle=−0°",), {"angle": "0 °"}),
        (None, ("angle=90°",), {"angle": "90 °"}),
        (None, ("flag=false", "mode=from_below"), {"flag": "false", "mode": "from_below"}),
        (None, ("temperatures=[5 °C]",), {"temperatures": "5 °C"}),
        (None, ("temperatures=[1 °C, {from: 2 °C, to: 0 °C, step: 2 °C}]",), {"temperatures": "1 °C, 2 °C, 0 °C"}),
        (None, ("temperatures={from: 10 °C, to: 0 °C, step: 5 °C}",), {"temperatures": "10 °C, 5 °C, 0 °C"}),
        (None, ("angle=${'1 rad' * 0}",), {"angle": "0 °"}),
    ],
)  # fmt: skip
def test_a_run_has_the_defaults_then_the_preset_then_what_is_set(tmp_path, preset, options, changed):
    assert chosen(plan_of(tmp_path, CHOICES, preset=preset, settings=options)) == DEFAULTS | changed


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("n", "expected name=value"),
        ("n=", "is empty, expected a value"),
        ("=5", "there is no parameter ''; expected angle, temperatures, n, mode or flag"),
        ("angel=5°", "there is no parameter 'angel'; did you mean 'angle'?"),
        ("n=5 V", "'n' is 5 V, expected a number without a unit"),
        ("n=[1, 2]", "'n' is a list, expected one value"),
        ("temperatures=5 °C", "'temperatures' is one value, expected a list"),
        ("temperatures=[]", "'temperatures' is empty, expected at least one value"),
        ("temperatures=[20 °C, 5]", "'temperatures' is 5, without a unit; write it like '5 °C'"),
        ("angle=91°", "'angle' is 91 °, expected at most 90 °"),
        ("angle=-1°", "'angle' is -1 °, expected at least 0 °"),
        ("angle=5 K", "kelvin is refused: write °C, for a difference too"),
        ("angle=${n}", "'${n}': there is no name 'n'; none is known here"),
        ("angle=90 %", "'angle' is '90 %', a ratio; expected a value like 10 °"),
        (
            "temperatures=[20 °C, 1.5.2 °C]",
            "'1.5.2 °C' is not a quantity; a number has one decimal point: write it like 1.5 °C",
        ),
        ("flag=yes", "'flag' is 'yes', expected a value like true"),
        ("mode=5", "'mode' is '5', expected a value like direct"),
        ("temperatures={form: 1 °C}", "unknown key 'form' in a range; did you mean 'from'?"),
    ],
)
def test_a_wish_that_does_not_fit_is_told_with_what_was_wished(tmp_path, setting, problem):
    assert problems_of(tmp_path, CHOICES, settings=[setting]) == [f"--set {setting}: {problem}"]


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("n=[1", "--set n:1:1: is not YAML: a comma is missing here, or a bracket is not closed"),
        ("n=!!python/name:os.system 3", "--set n:1:1: tags (!) are not part of this language; put text in quotes"),
        ("n=3\n---\n4", "--set n:2:1: a second document begins; one file holds one"),
        ("n=" + "[" * 10_000, "--set n:1:1: is nested more than 20 deep"),
    ],
)
def test_a_wish_that_is_no_document_is_told_with_its_place(tmp_path, setting, problem):
    assert problems_of(tmp_path, CHOICES, settings=[setting]) == [problem]


@pytest.mark.parametrize(
    ("preset", "body", "problem"),
    [
        ("wram", CHOICES, "there is no preset 'wram'; did you mean 'warm'?"),
        ("quick", CHOICES, "there is no preset 'quick'; expected warm"),
        ("quick", WAIT, "there is no preset 'quick'; none is known here"),
    ],
)
def test_an_unknown_preset_is_told_with_those_there_are(tmp_path, preset, body, problem):
    assert problems_of(tmp_path, body, preset=preset) == [problem]


PRESET = WAIT + "parameters: {p: {help: h, default: 5 V, max: 9 V}, q: {help: h, default: [1]}}\npresets:\n"


@pytest.mark.parametrize(
    ("preset", "problems"),
    [
        ("{help: h, set: {p: 10 V}}", ["4:22: 'p' is 10 V, expected at most 9 V"]),
        (
            "{help: h, set: {p: 1 A, q: 5}}",
            ["4:22: 'p' is 1 A, expected a quantity in V", "4:30: 'q' is one value, expected a list"],
        ),
        ("{help: h, set: {r: 1}}", ["4:22: there is no parameter 'r'; expected p or q"]),
        ("{help: h, set: {p: 1 apple}}", ["4:22: p: 'apple' is not a known unit"]),
        ("{set: {p: 1 V}}", ["4:3: the key 'help' is missing"]),
        ("{help: h, st: {p: 1 V}}", ["4:16: st: unknown key; did you mean 'set'?"]),
        ("{help: h, set: 5}", ["4:16: set: is 5, expected a mapping"]),
    ],
)
@pytest.mark.parametrize("wished", [None, "a"])
def test_a_preset_is_checked_whether_it_is_wished_for_or_not(tmp_path, preset, problems, wished):
    assert problems_of(tmp_path, f"{PRESET}  a: {preset}\n", preset=wished) == problems


# All at once

ALL_WRONG = """\
parameters: {p: {help: h, default: 5 V, max: 9 V}}
presets: {a: {help: h, set: {p: 10 V}}}
setup: [mov: head, wait: 5]
steps:
  - move: head
    to: 400°
  - for_each: a
    in: []
    steps: [wait: 1 s, nap: 1 s]
  - for_each: b
    in: [1 °C, 2 °C]
    steps:
      - {ramp: head, to: "${b}", at: 1 °C/min}
      - {ramp: chamber, to: "${c}", at: 1 °C/min}
teardown:
  - {set: supply, output: offf}
results: [{method: tumble, data: x}]
schema: itb-sequence/1
title: T
needs: {suppl: power_supply, head: positioner, chamber: thermal_chamber}
"""


def test_every_problem_is_told_at_once_the_wishes_first_then_in_the_order_of_the_file(tmp_path):
    assert problems_of(tmp_path, ALL_WRONG, tail="", preset="b", settings=["p=5 A", "q=1"]) == [
        "there is no preset 'b'; expected a",
        "--set p=5 A: 'p' is 5 A, expected a quantity in V",
        "--set q=1: there is no parameter 'q'; expected p",
        "2:30: 'p' is 10 V, expected at most 9 V",
        "3:9: unknown step 'mov'; did you mean 'move'?",
        "3:20: wait: 5 has no unit, write it like '5 s'",
        "6:5: to: 400 ° is above the 365 ° that the bench file allows 'head' (step steps/move)",
        "8:5: in: is empty, expected a list or a range with at least one value",
        f"9:24: unknown step 'nap'; expected {KINDS}",
        "13:10: 'ramp' needs a thermal_chamber, 'head' is a positioner",
        "14:25: to: '${c}': there is no name 'c'; expected p or b",
        "16:19: output: is 'offf', expected 'on' or 'off'",
        f"17:12: there is no method 'tumble'{did_you_mean('tumble', known_methods())}",
        "17:28: no step acquires with the label 'x'; none is known here",
        "20:9: the bench 'Simulated accelerometer bench' has no device 'suppl'; did you mean 'supply'?",
    ]


def test_a_wrong_head_and_wrong_steps_are_told_together(tmp_path):
    body = "parameters: {p: {help: h}}\nsteps: [mov: head]\nsetup: [wait: 5]\n"
    assert problems_of(tmp_path, body) == [
        "1:14: the key 'default' is missing",
        "2:9: unknown step 'mov'; did you mean 'move'?",
        "3:9: wait: 5 has no unit, write it like '5 s'",
    ]


# Whatever becomes of a file

SHIPPED = sorted((ROOT / "sequences").glob("*.yaml"))
TEXTS = [path.read_text("utf-8") for path in SHIPPED]
VALUES = [load_sequence(path)[0].value for path in SHIPPED]
WRONG = st.sampled_from(
    [None, "", 0, -1, 1.5, True, [], {}, [[]], [1, "5 V"], {"wait": "1 s"}, {"from": 1, "to": 3}, {"from": "0°"}, "on",
     "5 V", "-300 °C", "1e300 s", "${temperatures}", "${position}", "${1/0}", "${(1)(2)}", "${", "head", "x" * 5000,
     "unit_temperature", "thermometer", {"for_each": "x", "in": [1, 2], "steps": [{"wait": "${x * '1 s'}"}]}]
)  # fmt: skip
SNIPPETS = st.sampled_from(
    ["", " ", "\n", "\t", ":", "- ", "  - wait: 1 s\n", "{", "}", "[", "]", "'", '"', "#", "&a ", "*a", "!!str ", "?",
     "---\n", "%YAML 1.1\n", "\x00", "\ufeff", "°C", "5", "-", "${", "${x}", "| ", "> ", ",", "<<: 1\n", "\r", "½"]
)  # fmt: skip


@st.composite
def mutated_values(draw):
    """A shipped sequence with up to three of its nodes taken out, put elsewhere or made into something else."""
    value = deepcopy(draw(st.sampled_from(VALUES)))
    for _ in range(draw(st.integers(1, 3))):
        inner, key = draw(st.sampled_from(list(nodes(value)) or [({0: 0}, 0)]))
        change = draw(st.sampled_from(["delete", "replace", "rename", "repeat"]))
        if change == "delete":
            del inner[key]
        elif change == "replace":
            inner[key] = deepcopy(draw(WRONG))
        elif isinstance(inner, dict):
            inner[draw(st.sampled_from(["steps", "to", "wait", "for_each", "x", "", "Head"]))] = inner.pop(key)
        else:
            inner.insert(0, deepcopy(inner[key]))
    return json.dumps(value, ensure_ascii=False)


def nodes(value):
    """Every value inside a mapping or list: what it is in, and its key."""
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from nodes(part)


@st.composite
def mutated_texts(draw):
    """The text of a shipped sequence with a slice of it taken out, and something else put there."""
    text = draw(st.sampled_from(TEXTS))
    begin = draw(st.integers(0, len(text)))
    length = draw(st.integers(0, 40))
    return text[:begin] + draw(SNIPPETS | st.text(max_size=5)) + text[begin + length :]


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.one_of(mutated_values(), mutated_texts()))
def test_any_change_of_a_shipped_sequence_gives_a_plan_or_says_what_is_wrong_where(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "mutated.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    found: tuple[str, ...] = ()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(expand, "STEP_LIMIT", 2000)  # as many steps as a test has time for
        try:
            plan = load_plan(path, BENCH)
        except InputError as error:
            found = error.problems
        else:
            assert 0 < len(plan) <= 2000
            return
    assert found
    assert all(problem.startswith(f"{path}:") and "\n" not in problem for problem in found)
    assert len(set(found)) == len(found)


# A file of parameters


PARAMETERS = """\
parameters:
  angle: {help: h, default: 5°, min: 0°}
  times: {help: h, default: [1 s, 2 s]}
  count: {help: h, default: 3}
presets:
  far: {help: h, set: {angle: 90°, count: 4}}
"""


def with_file(folder, text, **options):
    path = folder / "p.yaml"
    path.write_text(text, "utf-8")
    return {"tail": PARAMETERS + TAIL, "parameters": path, **options}


def test_a_file_of_parameters_stands_between_the_preset_and_the_single_wishes(tmp_path):
    options = with_file(
        tmp_path, "angle: 45°\ntimes: {from: 1 s, to: 3 s, step: 1 s}\n", preset="far", settings=["angle=60°"]
    )
    assert chosen(plan_of(tmp_path, WAIT, **options)) == {"angle": "60 °", "times": "1 s, 2 s, 3 s", "count": "4"}
    assert chosen(plan_of(tmp_path, WAIT, **with_file(tmp_path, "angle: 45°\n")))["angle"] == "45 °"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("angel: 45°\n", "p.yaml:1:1: there is no parameter 'angel'; did you mean 'angle'?"),
        ("angle: -45°\n", "p.yaml:1:1: 'angle' is -45 °, expected at least 0 °"),
        ("count: 1\nangle: 5 s\n", "p.yaml:2:1: 'angle' is 5 s, expected a quantity in °"),
        ("angle: 5 K\n", "p.yaml:1:1: 'angle' kelvin is refused: write °C, for a difference too"),
        ("angle:\n", "p.yaml:1:1: 'angle' is empty, expected a value"),
        ("[angle]\n", "p.yaml:1:1: is a list, expected a mapping of parameters to values"),
        ("", "p.yaml:1:1: is empty, expected a mapping of parameters to values"),
        ("angle: 5°\nangle: 6°\n", "p.yaml:2:1: the key 'angle' stands twice; it is already in line 1"),
    ],
)
def test_what_is_wrong_with_a_file_of_parameters_is_told_at_its_place(tmp_path, text, problem):
    assert problems_of(tmp_path, WAIT, **with_file(tmp_path, text)) == [f"{tmp_path}/{problem}"]


def test_a_file_of_parameters_that_is_not_there_is_told_among_the_rest(tmp_path):
    options = {"tail": PARAMETERS + TAIL, "parameters": tmp_path / "none.yaml", "settings": ["count=1 s"]}
    assert problems_of(tmp_path, WAIT, **options) == [
        f"{tmp_path}/none.yaml: there is no such file",
        "--set count=1 s: 'count' is 1 s, expected a number without a unit",
    ]
