"""Settings of results that name the parameters of a sequence, and names that are expressions."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.errors import InputError
from bench.sequence.load import load_judged_plan, load_sequence
from bench.sequence.plan.result_settings import as_chosen
from bench.sequence.steps.talk import PhysicalChange, Prompt
from tests.support.sequences import ROOT

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
