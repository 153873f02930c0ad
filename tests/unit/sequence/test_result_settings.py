"""Settings of results that name the parameters of a sequence, and names that are expressions."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.errors import InputError
from bench.sequence.document.schema import sequence_schema
from bench.sequence.load import load_judged_plan, load_sequence
from bench.sequence.plan.result_settings import as_chosen
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.talk import PhysicalChange, Prompt
from drivers.quantity.quantities import Quantity, parse
from drivers.schema.fields import EXPRESSION
from tests.support.sequences import BENCH, ROOT

SMOKE = (ROOT / "sequences/smoke.yaml").read_text("utf-8")
CHANNEL, CHANNEL_IMU, MIXED = (
    load_bench(ROOT / f"config/{name}.yaml").bench for name in ("channel", "channel_imu", "every_dialect")
)
FULL = ROOT / "sequences/channel_full.yaml"
MEASURED = """\
schema: itb-sequence/1
title: Measured
needs: {{output: output, supply: power_supply}}
parameters: {{watched: {{help: an output, default: {watched}}}}}
steps:
  - {{measure: "${{watched}}", for: 10 s, as: value}}
"""


@pytest.mark.parametrize(("given", "basis"), [({}, "normalised"), ({"preset": "raw"}, "raw")])
def test_a_setting_has_the_value_of_its_parameter(given, basis):
    plan, _ = load_judged_plan(FULL, CHANNEL, **given)
    assert plan.sequence.results[0].settings["compare_basis"] == basis
    assert plan.sequence.results[0].settings["threshold"] == "5 %"


def test_a_value_that_the_setting_does_not_take_is_refused_at_its_line():
    with pytest.raises(InputError) as refused:
        load_judged_plan(FULL, CHANNEL, settings=["basis=both"])
    line = next(n for n, text in enumerate(FULL.read_text("utf-8").splitlines(), 1) if "compare_basis" in text)
    (problem,) = refused.value.problems
    assert f"channel_full.yaml:{line}:" in problem
    assert "expected 'normalised' or 'raw'" in problem


def test_a_name_that_is_no_parameter_is_refused(tmp_path):
    path = tmp_path / "channel_full.yaml"
    for called in ("gravity", "skew", "source"):
        (tmp_path / f"channel_{called}.yaml").write_text((ROOT / f"sequences/channel_{called}.yaml").read_text("utf-8"))
    path.write_text(FULL.read_text("utf-8").replace("${basis}", "${bases}"), "utf-8")
    with pytest.raises(InputError, match="there is no name 'bases'; did you mean 'basis'"):
        load_judged_plan(path, CHANNEL)


def with_setting(folder, written, parameter):
    """The smoke test with other settings of its result, and one parameter more."""
    text = SMOKE.replace("{degree: 4}", written).replace("parameters:\n", f"parameters:\n  {parameter}\n")
    path = folder / "smoke.yaml"
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize(
    ("written", "default", "value"),
    [
        ("{degree: '${n}'}", "3", 3),
        ("{degree: '${n + 1}'}", "3", 4),
        ("{degree: '${n / 2}'}", '"4"', 2),
        ("{reference: '${n}'}", "-5 °C", "-5 °C"),
        ("{reference: '${-n}'}", "5 °C", "-5 °C"),
        ("{closure_limit: '${n * 2}'}", "20 µg", "4e-05 g"),
    ],
)
def test_a_number_of_a_parameter_is_a_number_and_a_quantity_keeps_its_unit(written, default, value, tmp_path):
    path = with_setting(tmp_path, written, f"n: {{help: a number, default: {default}}}")
    (setting,) = load_judged_plan(path, BENCH)[0].sequence.results[0].settings.values()
    assert setting == value
    assert type(setting) is type(value)


@pytest.mark.parametrize(
    ("written", "default", "problem"),
    [
        ("{degree: '${m}'}", "3", "degree: '${m}': there is no name 'm'"),
        ("{degree: '${n * '}", "3", "degree: '${n * ': an expression is the whole value"),
        ("{degree: '${n}'}", "9", "degree: is 9, expected"),
        ("{degree: '${n}'}", "2.5", "degree: is 2.5, expected"),
        ("{degree: '${n}'}", "true", "degree: is true, expected"),
        ("{degree: '${n}'}", "[1, 2]", "degree: is a list, expected a whole number"),
        ("{degree: '${n}'}", "-4", "degree: is -4, expected"),
        ("{closure_limit: '${n}'}", "3", "closure_limit: 3 has no unit"),
        ("{reference: '${n + m}'}", "3 °C", "reference: '${n + m}': there is no name 'm'"),
    ],
)
def test_a_wrong_expression_or_value_is_one_problem(written, default, problem, tmp_path):
    path = with_setting(tmp_path, written, f"n: {{help: a number, default: {default}}}")
    with pytest.raises(InputError) as refused:
        load_judged_plan(path, BENCH)
    (found,) = refused.value.problems
    assert problem in found


@pytest.mark.parametrize(
    ("default", "chosen", "value"),
    [
        ("3", "2", 2),
        ("0.5", "-0.25", -0.25),
        ("false", "true", True),
        ("true", "false", False),
        ("[true, false]", "false, true", [False, True]),
        ("[1, 2]", "-4", [-4]),
        ("[1 g, 2 g]", "-4 g, 5 %", ["-4 g", "5 %"]),
        ("on", "off", "off"),
    ],
)
def test_a_stored_run_has_values_of_the_kind_of_the_default(default, chosen, value, tmp_path):
    _, kept = load_sequence(with_setting(tmp_path, "{degree: '${n}'}", f"n: {{help: a number, default: {default}}}"))
    setting = as_chosen(kept, {"n": chosen}).results[0].settings["degree"]
    assert setting == value
    assert type(setting) is type(value)


def test_a_stored_run_evaluates_a_condition(tmp_path):
    _, kept = load_sequence(
        with_setting(tmp_path, "{degree: '${4 if n else 2}'}", "n: {help: all terms, default: true}")
    )
    assert [as_chosen(kept, {"n": n}).results[0].settings["degree"] for n in ("true", "false")] == [4, 2]


def test_a_number_of_an_expression_in_a_step_of_a_plug_in_is_a_number():
    step = Custom.model_validate({"custom": "s", "with": {"n": Quantity(3.0), "t": [parse("2 s"), parse("5 %")]}})
    assert step.settings == {"n": 3, "t": [parse("2 s"), parse("5 %")]}
    assert type(step.settings["n"]) is int


def test_the_schema_has_an_expression_for_a_whole_number():
    settings = sequence_schema()["$defs"]["TemperatureTumbleSettings"]["properties"]
    assert settings["degree"]["anyOf"] == [
        {"type": "integer", "minimum": 1, "maximum": 4},
        {"type": "string", "pattern": EXPRESSION},
    ]


def test_a_stored_run_has_the_settings_of_its_manifest():
    _, kept = load_sequence(FULL)
    written = {"basis": "raw", "levels": "1 g, 12 g", "gone": "1"}
    assert as_chosen(kept, written).results[0].settings["compare_basis"] == "raw"
    assert kept.results[0].settings["compare_basis"] == "${basis}"


@pytest.mark.parametrize(
    ("watched", "bench", "problem"),
    [
        ("output.a.acc_z", CHANNEL_IMU, ""),
        ("output.a", CHANNEL, ""),
        ("output.a", CHANNEL_IMU, "has several outputs; name one of its accelerometers, such as output.a.acc_x"),
        ("output.a.gyro_x", CHANNEL_IMU, "has several outputs"),
        ("output.a.acc_x", CHANNEL, "has one output; name it output.a"),
    ],
)
def test_the_output_of_one_accelerometer_of_an_inertial_unit_is_measured_by_its_name(watched, bench, problem, tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(MEASURED.format(watched=watched), "utf-8")
    if problem:
        with pytest.raises(InputError, match=problem):
            load_judged_plan(path, bench)
    else:
        (planned,) = load_judged_plan(path, bench)[0]
        assert planned.step.reading == watched


def test_a_channel_is_for_the_cable_of_a_source():
    with pytest.raises(ValueError, match="give input: source as well"):
        PhysicalChange.model_validate({"input": "accelerometer", "channel": "acc_x"})
    assert PhysicalChange.model_validate({"input": "source", "channel": "none"}).fed_channel == ""


def test_each_prompt_of_the_shipped_sequence_names_the_mount_or_the_channel():
    plan, remarks = load_judged_plan(ROOT / "sequences/channel_imu.yaml", CHANNEL_IMU)
    expected = [each.step.expect for each in plan if isinstance(each.step, Prompt) and each.step.expect is not None]
    assert remarks == ()
    assert [each.mount or each.fed_channel or each.input for each in expected] == [
        "x_up", "y_up", "z_up", "skew", "acc_x", "acc_y", "acc_z", "accelerometer",
    ]  # fmt: skip


def test_of_units_of_both_kinds_the_channels_are_measured_unless_an_inertial_unit_is_named():
    plan, _ = load_judged_plan(FULL, MIXED)
    fed = {each.step.place for each in plan if getattr(each.step, "acceleration_g", None) is not None}
    assert fed == {"a"}
    assert MIXED.places["a"].kind == "channel"
