"""A plan against a bench: needs, roles, the limits of the bench file, and what a report is to judge."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.sequence.method import known_methods
from tests.support.sequences import BENCH, ELSEWHERE, ROOT, load_plan, plan_of, problems_of, steps

SHIPPED = sorted((ROOT / "sequences").glob("*.yaml"))
METHODS = " or ".join(", ".join(sorted(known_methods())).rsplit(", ", 1))
HEAD = "schema: itb-sequence/1\ntitle: T\n"
WAIT = "steps: [wait: 1 s]\n"


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_sequence_fits_a_shipped_bench_with_every_preset(path):
    bench = load_bench(ROOT / "config" / f"{ELSEWHERE.get(path.stem, ('simulated',))[0]}.yaml").bench
    for preset in (None, *load_plan(path, bench).sequence.presets):
        assert len(load_plan(path, bench, preset=preset)) > 0


# Needs


@pytest.mark.parametrize(
    ("needs", "problem"),
    [
        ("chambr: thermal_chamber", "has no device 'chambr'; did you mean 'chamber'?"),
        ("arm: positioner", "has no device 'arm'; expected chamber, head, counter, supply or source"),
        ("unit_temp: thermometer", "has no reading 'unit_temp'; did you mean 'unit_temperature'?"),
        ("chamber: thermometer", "has no reading 'chamber'; expected unit_temperature"),
        ("unit_temperature: pulse_counter",
         "has no device 'unit_temperature'; expected chamber, head, counter, supply or source"),
    ],
)  # fmt: skip
def test_what_the_bench_lacks_is_told(tmp_path, needs, problem):
    assert problems_of(tmp_path, WAIT, tail=f"{HEAD}needs: {{{needs}}}\n") == [
        f"4:9: the bench 'Simulated accelerometer bench' {problem}"
    ]


def test_a_device_of_another_kind_is_told_with_what_it_is(tmp_path):
    assert problems_of(tmp_path, WAIT, tail=f"{HEAD}needs: {{head: pulse_counter, source: power_supply}}\n") == [
        "4:9: the sequence needs a pulse_counter, 'head' of the bench is a positioner",
        "4:30: the sequence needs a power_supply, 'source' of the bench is a current_source",
    ]


def test_what_the_bench_lacks_is_told_with_the_needs_and_not_again_with_each_step(tmp_path):
    body = steps("{move: arm, to: 400°}", "{ramp: head, to: 500 °C, at: 1 °C/min}")
    assert problems_of(tmp_path, body, tail=f"{HEAD}needs: {{arm: positioner, head: thermal_chamber}}\n") == [
        "6:9: the bench 'Simulated accelerometer bench' has no device 'arm'; "
        "expected chamber, head, counter, supply or source",
        "6:26: the sequence needs a thermal_chamber, 'head' of the bench is a positioner",
    ]


# Roles


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{move: chamber, to: 5°}", "'move' needs a positioner or rate_table, 'chamber' is a thermal_chamber"),
        ("{ramp: head, to: 5 °C, at: 1 °C/min}", "'ramp' needs a thermal_chamber, 'head' is a positioner"),
        ("{set: head, output: off}", "'set' needs a power_supply or current_source, 'head' is a positioner"),
        ("{soak: chamber, at_least: 5 s}", "'soak' needs a thermometer, 'chamber' is a thermal_chamber"),
        (
            "{acquire: supply, for: 5 s, label: a}",
            "'acquire' needs a pulse_counter or voltmeter or telemetry or output, 'supply' is a power_supply",
        ),
        ("{move: haed, to: 5°}", "'haed' is not among the needs of the sequence; did you mean 'head'?"),
        (
            "{soak: oven, at_least: 5 s}",
            "'oven' is not among the needs of the sequence; "
            "expected chamber, head, counter, supply, source or unit_temperature",
        ),
    ],
)
@pytest.mark.parametrize("bench", [BENCH, None], ids=["bench", "no bench"])
def test_a_step_acts_on_a_need_of_the_right_kind(tmp_path, step, problem, bench):
    assert problems_of(tmp_path, steps(step), bench=bench) == [f"2:6: {problem}"]


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        (
            "{set: supply, output: on, current: 1 mA, compliance: 1 V}",
            "2:31: 'supply' is a power_supply, which takes voltage and current_limit",
        ),
        (
            "{set: source, output: on, voltage: 1 V, current_limit: 1 mA}",
            "2:31: 'source' is a current_source, which takes current and compliance",
        ),
    ],
)
def test_a_source_takes_the_levels_of_its_kind(tmp_path, step, problem):
    assert problems_of(tmp_path, steps(step)) == [problem]


def test_without_a_bench_nothing_is_beyond_its_limits(tmp_path):
    assert len(plan_of(tmp_path, steps("{move: head, to: 4000°}"), bench=None)) == 1


# Limits


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{move: head, to: 365.5°}", "2:18: to: 365.5 ° is above the 365 ° that the bench file allows 'head'"),
        ("{move: head, to: -6°}", "2:18: to: -6 ° is below the -5 ° that the bench file allows 'head'"),
        ("{move: head, to: 365°, approach: from_above}",
         "2:28: approach: begins where 367 ° is above the 365 ° that the bench file allows 'head'"),
        ("{move: head, to: -5°, approach: from_below}",
         "2:27: approach: begins where -7 ° is below the -5 ° that the bench file allows 'head'"),
        ("{move: head, to: 400°, approach: from_above}",
         "2:18: to: 400 ° is above the 365 ° that the bench file allows 'head'"),
        ("{ramp: chamber, to: 100.1 °C, at: 1 °C/min}",
         "2:21: to: 100.1 °C is above the 100 °C that the bench file allows 'chamber'"),
        ("{ramp: chamber, to: -60 °C, at: 1 °C/min}",
         "2:21: to: -60 °C is below the -50 °C that the bench file allows 'chamber'"),
        ("{ramp: chamber, to: 20 °C, at: 5 °C/min}",
         "2:32: at: 5 °C/min is above the 3 °C/min that the bench file allows 'chamber'"),
        ("{set: supply, voltage: 17 V, current_limit: 1 mA, output: on}",
         "2:19: voltage: 17 V is above the 16 V that the bench file allows 'supply'"),
        ("{set: supply, voltage: 5 V, current_limit: 1 A, output: on}",
         "2:33: current_limit: 1 A is above the 0.2 A that the bench file allows 'supply'"),
        ("{set: source, current: 25 mA, compliance: 9 V, output: on}",
         "2:19: current: 0.025 A is above the 0.02 A that the bench file allows 'source'"),
        ("{set: source, current: -25 mA, compliance: 9 V, output: on}",
         "2:19: current: -0.025 A is below the -0.02 A that the bench file allows 'source'"),
        ("{set: source, current: 1 mA, compliance: 11 V, output: on}",
         "2:34: compliance: 11 V is above the 10 V that the bench file allows 'source'"),
        ("{soak: unit_temperature, at_least: 2 h, give_up_after: 1 h}",
         "2:45: give_up_after: is shorter than the soak itself"),
        ("{soak: unit_temperature, at_least: 1 s, until_stable: {band: 1 °C, slope: 1 °C/h, hold: 2 h}, "
         "give_up_after: 1 h}",
         "2:99: give_up_after: is shorter than the soak itself"),
    ],
)  # fmt: skip
def test_a_value_beyond_the_limits_of_the_bench_file_is_told_with_the_step(tmp_path, step, problem):
    verb = step[1:].partition(":")[0]
    assert problems_of(tmp_path, steps(step)) == [f"{problem} (step steps/{verb})"]


@pytest.mark.parametrize(
    "step",
    [
        "{move: head, to: 365°}",
        "{move: head, to: -5°}",
        "{move: head, to: -3°, approach: from_below}",
        "{move: head, to: 363°, approach: from_above}",
        "{ramp: chamber, to: -50 °C, at: 180 °C/h}",
        "{ramp: chamber, to: 100 °C, at: 3 °C/min}",
        "{set: supply, voltage: 16 V, current_limit: 200 mA, output: on}",
        "{set: source, current: -20 mA, compliance: 10 V, output: on}",
        "{set: supply, output: off}",
        "{soak: unit_temperature, at_least: 1 h, give_up_after: 60 min}",
        "{soak: unit_temperature, at_least: 1 h}",
        "{acquire: counter, for: 1 s, label: a}",
    ],
)
def test_limits_are_allowed_themselves(tmp_path, step):
    off = "teardown: [{set: supply, output: off}, {set: source, output: off}]\n"
    assert len(plan_of(tmp_path, steps(step) + off).steps) == 1


def test_a_value_beyond_the_limits_in_many_passes_is_told_once_with_the_first_step(tmp_path):
    inside = "[{ramp: chamber, to: '${t}', at: 4 °C/min}]"
    body = steps(f"{{for_each: t, in: [20 °C, 110 °C, 120 °C, 110 °C], steps: {inside}}}")
    assert problems_of(tmp_path, body) == [
        "2:80: to: 110 °C is above the 100 °C that the bench file allows 'chamber' (step steps/t=110/ramp)",
        "2:92: at: 4 °C/min is above the 3 °C/min that the bench file allows 'chamber' (step steps/t=20/ramp)",
    ]


# Results

COUNT = steps(
    "{acquire: counter, for: 5 s, label: tumble}",
    "{for_each: a, in: [1], steps: [{acquire: counter, for: 5 s, label: inner}]}",
)
ALL = " or ".join(", ".join(TEMPERATURE_TUMBLE.quantities).rsplit(", ", 1))


def result_problems(folder, entry):
    return problems_of(folder, f"{COUNT}results:\n  - {entry}\n")


@pytest.mark.parametrize(
    ("entry", "problems"),
    [
        ("{method: temperature_tumbl, data: tumble}",
         ["5:6: there is no method 'temperature_tumbl'; did you mean 'temperature_tumble'?"]),
        ("{method: fft, data: tumble}",
         [f"5:6: there is no method 'fft'; expected {METHODS}"]),
        ("{method: temperature_tumble, data: tumbl}",
         ["5:34: no step acquires with the label 'tumbl'; did you mean 'tumble'?"]),
        ("{method: temperature_tumble, data: outer}",
         ["5:34: no step acquires with the label 'outer'; expected inner or tumble"]),
        ("{method: fft, data: x}", [f"5:6: there is no method 'fft'; expected {METHODS}",
                                    "5:19: no step acquires with the label 'x'; expected inner or tumble"]),
        ("{method: temperature_tumble}", ["5:5: the key 'data' is missing"]),
        ("{method: 5, data: tumble}", ["5:6: method: is 5, expected text; put it in quotes"]),
        ("{methd: temperature_tumble, data: tumble}", ["5:6: methd: unknown key; did you mean 'method'?"]),
    ],
)  # fmt: skip
def test_a_result_names_a_method_and_a_label(tmp_path, entry, problems):
    assert result_problems(tmp_path, entry) == problems


@pytest.mark.parametrize(
    ("settings", "problems"),
    [
        ("{degree: 5}", ["5:59: degree: is 5, expected at most 4"]),
        ("{degree: 0}", ["5:59: degree: is 0, expected at least 1"]),
        ("{degree: 2.5}", ["5:59: degree: is 2.5, expected a whole number"]),
        ("{degree: two}", ["5:59: degree: is 'two', expected a whole number"]),
        ("{degree: true}", ["5:59: degree: is true, expected a whole number"]),
        ("{degre: 3}", ["5:59: degre: unknown key; did you mean 'degree'?"]),
        ("5", ["5:48: settings: is 5, expected a mapping"]),
        ("", ["5:48: settings: is empty, expected a mapping"]),
    ],
)
def test_the_settings_are_those_of_the_method(tmp_path, settings, problems):
    assert result_problems(tmp_path, f"{{method: temperature_tumble, data: tumble, settings: {settings}}}") == problems


@pytest.mark.parametrize(
    ("limit", "problem"),
    [
        ("K0: {min: 5 mg, max: -5 mg}", "K0: min is above max"),
        ("k0: {max: 1 g}", "temperature_tumble has no result 'k0'; did you mean 'K0'?"),
        ("bias: {max: 1 g}", f"temperature_tumble has no result 'bias'; expected {ALL}"),
        ("misalignmnt: {max: 1 mrad}", "temperature_tumble has no result 'misalignmnt'; did you mean 'misalignment'?"),
        ("K0/hysteresis: {}", "K0/hysteresis: needs min or max, or both, or a target with its tolerance, or u_max"),
        ("K0/hysteresis: 5 mg", "K0/hysteresis: is '5 mg', expected a mapping"),
    ],
)
def test_a_limit_is_that_of_a_known_result(tmp_path, limit, problem):
    entry = f"{{method: temperature_tumble, data: tumble, limits: {{{limit}}}}}"
    assert result_problems(tmp_path, entry) == [f"5:57: {problem}"]


@pytest.mark.parametrize(
    ("limit", "problem"),
    [
        ("K0: {max: 1 apple}", "5:62: max: 'apple' is not a known unit"),
        ("K0: {max: [1 g]}", "5:62: max: is a list, expected a quantity"),
        ("K0: {mx: 1 g, min: 0 g}", "5:62: mx: unknown key; did you mean 'max'?"),
        ("K0: {max: 5}", "5:62: max: is a bare number, expected a quantity in g"),
        ("K2: {max: 5 mg}", "5:62: max: is in g, expected a quantity in g/g²"),
        ("misalignment: {min: 5 mrad, max: 1 g}", "5:85: max: is in g, expected a quantity in rad"),
        ("K1/hysteresis: {max: 5 mg}", "5:73: max: is in g, expected a number without a unit"),
        ("K1: {target: 9 g, relative: 1 %}", "5:62: target: is in g, expected a quantity in pulse/s/g"),
        ("K0: {max: 5 mg, marginal: 5 mV}", "5:73: marginal: is in V, expected a quantity in g"),
    ],
)
def test_a_side_of_a_limit_is_a_quantity_in_the_unit_of_the_result(tmp_path, limit, problem):
    entry = f"{{method: temperature_tumble, data: tumble, limits: {{{limit}}}}}"
    assert result_problems(tmp_path, entry) == [problem]


def test_a_label_that_is_wrong_itself_is_the_only_problem_told(tmp_path):
    body = steps("{acquire: counter, for: 5 s, label: 5}") + "results: [{method: temperature_tumble, data: tumble}]\n"
    assert problems_of(tmp_path, body) == ["2:34: label: is 5, expected text; put it in quotes"]


def test_the_label_of_a_step_that_is_wrong_otherwise_is_known(tmp_path):
    body = steps("{acquire: counter, for: 5, label: tumble}")
    assert problems_of(tmp_path, body + "results: [{method: temperature_tumble, data: tumble}]\n") == [
        "2:24: for: 5 has no unit, write it like '5 s'"
    ]
