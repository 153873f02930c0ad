"""M0: figures printed in equations 2, typed by hand; keys of the result; what is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bench.errors import InputError
from bench.methods.channel.offline import RunSettings
from bench.methods.channel.reduction.decision import compare, out_of_proportion
from bench.methods.channel.reduction.line import ChannelRun, ramp_of
from bench.metrology.gates import Gates
from bench.metrology.least_squares import reject_outliers
from bench.offline.case import reduce_case
from tests.support.m0_cases import SETTINGS, Channel, campaign, write_case

NO_GATES = Gates(*(np.zeros(0) for _ in range(6)))
RUN = ChannelRun(
    rate=11_300.0, u_rate=0.01, slope_per_c=0.1, u_slope_per_c=0.001, residual_rms=0.3,
    gates_used=600, span_c=45.0, ramp_c_per_h=25.0, flags=(), notes=(), excluded={},
    gates=NO_GATES,
)  # fmt: skip


def scaled(level, **changes):
    """A run of a converter whose drift is all in proportion to the level."""
    return replace(RUN, rate=level * RUN.rate, slope_per_c=level * RUN.slope_per_c, **changes)


def test_the_skew_level():
    printed_deg = 54 + 44 / 60 + 8 / 3600
    level_g = RunSettings(kind="gravity", tilt_deg=printed_deg).level_g
    assert level_g == pytest.approx(0.577351, abs=5e-7)
    assert 1 / math.sqrt(3) == pytest.approx(0.577350, abs=5e-7)
    assert (level_g - 1 / math.sqrt(3)) * 1e6 == pytest.approx(0.78, abs=0.005)  # µg
    exact_deg = math.degrees(math.acos(1 / math.sqrt(3)))
    assert (exact_deg - printed_deg) * 3600 == pytest.approx(0.197, abs=5e-4)


def test_the_level_of_a_source():
    assert RunSettings(kind="source", I_mA=13.56, K1_mA_per_g=1.13).level_g == pytest.approx(12.0)


def test_a_pure_scale_part_departs_by_42_and_1100_percent_raw_and_not_at_all_normalised():
    skew = compare(scaled(1 / math.sqrt(3)), RUN, threshold=0.05, basis="raw")
    source = compare(scaled(12.0), RUN, threshold=0.05, basis="raw")
    assert round(100 * skew.raw.value) == 42
    assert 100 * source.raw.value == pytest.approx(1100)
    assert skew.normalised.value == pytest.approx(0, abs=1e-12)
    assert source.normalised.value == pytest.approx(0, abs=1e-12)
    assert (skew.decision, source.decision) == ("keep", "keep")
    assert compare(scaled(12.0), RUN, threshold=0.05, basis="normalised").decision == "share"


def test_the_uncertainty_of_a_deviation():
    run = replace(RUN, rate=22_600.0, slope_per_c=0.15, u_slope_per_c=0.002)
    found = compare(run, RUN, threshold=0.3, basis="raw")
    assert found.raw == pytest.approx((0.5, math.sqrt((0.002 / 0.1) ** 2 + (0.15 * 0.001 / 0.1**2) ** 2), 0.05))
    ratio = (0.15 / 22_600) / (0.1 / 11_300)
    u = ratio * math.sqrt((0.002 / 0.15) ** 2 + (0.001 / 0.1) ** 2)
    assert found.normalised == pytest.approx((1 - ratio, u, abs(0.15 / 22_600 - 0.1 / 11_300)))


@pytest.mark.parametrize(
    ("threshold", "decision", "marginal"),
    [(0.5, "share", True), (0.4999, "keep", True), (0.6, "share", False), (0.4, "keep", False)],
)
def test_the_threshold_is_included(threshold, decision, marginal):
    run = replace(RUN, slope_per_c=0.15, u_slope_per_c=0.001)
    found = compare(run, replace(RUN, slope_per_c=0.1), threshold=threshold + 1e-12, basis="raw")
    assert (found.decision, found.marginal) == (decision, marginal)


@pytest.mark.parametrize(
    ("reference", "certain"),
    [
        (replace(RUN, u_slope_per_c=0.0333), True),
        (replace(RUN, u_slope_per_c=0.0334), False),
        (replace(RUN, slope_per_c=-0.1, u_slope_per_c=0.0333), True),
        (replace(RUN, slope_per_c=0.0, u_slope_per_c=0.0), False),
        (replace(RUN, slope_per_c=1e-11, u_slope_per_c=1e-13), False),
    ],
)
def test_a_slope_within_three_uncertainties_is_nothing_to_divide_by(reference, certain):
    found = compare(RUN, reference, threshold=0.05, basis="raw")
    assert (found.decision != "invalid") == certain
    assert math.isfinite(found.raw.value) == certain
    assert found.raw.difference == abs(RUN.slope_per_c - reference.slope_per_c)


def test_no_rate_no_relative_slope():
    still = replace(RUN, rate=0.0)
    assert compare(still, RUN, threshold=0.05, basis="raw").decision == "share"
    found = compare(still, RUN, threshold=0.05, basis="normalised")
    assert (found.decision, found.remarks) == ("invalid", ("no decision: a rate is 0",))


def test_how_fast_a_run_was_heated_and_cooled():
    up, down = np.arange(0.0, 6480.0, 10.0), np.arange(10.0, 3610.0, 10.0)
    time_s = np.concatenate([up, up[-1] + down])
    course_c = np.concatenate([10 + 25 * up / 3600, 10 + 25 * up[-1] / 3600 - 45 * down / 3600])
    found = ramp_of(time_s, course_c)
    assert (found.usual_c_per_h, found.fastest_c_per_h) == (pytest.approx(25), pytest.approx(45))
    coarse = ramp_of(up, np.round(10 + 30 * up / 3600))
    assert coarse.fastest_c_per_h == pytest.approx(30, rel=0.02), "a thermometer with steps of 1 °C"
    assert np.isnan(ramp_of(up[:1], course_c[:1])).all()


def test_a_run_heated_too_fast_decides_and_a_narrow_one_does_not():
    assert compare(replace(RUN, flags=("ramp_too_fast",)), RUN, threshold=1, basis="raw").decision == "share"
    narrow = replace(RUN, flags=("insufficient_temperature_span",))
    assert compare(narrow, RUN, threshold=1, basis="raw").decision == "invalid"
    assert compare(RUN, narrow, threshold=1, basis="raw").decision == "invalid"


def test_levels_out_of_proportion():
    levels_g = np.array([1.0, 0.577, 12.0, 1000.0, 0.01, np.inf, -1.0])
    rates_pps = np.array([11_302.0, 6522.0, 135_602.0, 11_302.0, 9.0, 1.0, -11_298.0])
    assert out_of_proportion(levels_g, rates_pps).tolist() == [False, False, False, True, False, False, False]
    assert not out_of_proportion(np.array([1.0]), np.array([np.nan])).any()


def test_a_count_is_no_outlier_where_most_readings_are_the_same_count():
    design, y = np.ones((40, 1)), np.full(40, 1000.0)
    y[[3, 17]] = [1001.0, 1010.0]
    assert reject_outliers(design, y).dropped == [3, 17]
    assert reject_outliers(design, y, resolution=0.408).dropped == [17]
    coarse = np.full(40, 0.408)
    coarse[17] = 2.0
    assert reject_outliers(design, y, resolution=coarse).dropped == []


def refusal(folder, **settings):
    with pytest.raises(InputError) as caught:
        reduce_case(write_case(folder, {}, SETTINGS | settings))
    return str(caught.value)


def test_result_has_the_keys_of_the_method(tmp_path):
    result = reduce_case(write_case(tmp_path, campaign(np.random.default_rng(1), Channel())))
    assert list(result) == ["method", "sub", "runs", "deviation", "channel", "flags", "notes", "rejected"]
    assert list(result["runs"]) == ["up_1g", "skew", "src_1g", "src_12g"]
    assert list(result["runs"]["up_1g"]) == [
        "a_g", "D_ref_pps", "u_D_ref", "k_pps_per_C", "u_k", "kappa_per_C", "residual_rms_pps", "n_used", "rejected",
        "span_C", "ramp_C_per_h", "flags",
    ]  # fmt: skip
    assert list(result["deviation"]) == ["skew", "src_1g", "src_12g"]
    assert list(result["deviation"]["skew"]) == [
        "reference", "dk_raw", "dk_norm", "u_dk_raw", "u_dk_norm", "dk_abs_pps_per_C", "dkappa_abs_per_C", "decision",
        "marginal", "final_c0", "final_k",
    ]  # fmt: skip
    assert list(result["channel"]) == [
        "tempco_offset_pps_per_C", "tempco_scale_per_C", "u_tempco_offset_pps_per_C", "u_tempco_scale_per_C",
    ]  # fmt: skip
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_a_record_without_a_row_is_reduced_to_nothing(tmp_path):
    result = reduce_case(write_case(tmp_path, {}))
    assert result["flags"] == [f"{name}:invalid" for name in ("up_1g", "skew", "src_1g", "src_12g")]
    assert result["runs"]["up_1g"]["k_pps_per_C"] is None
    assert {found["decision"] for found in result["deviation"].values()} == {"invalid"}
    assert json.loads(json.dumps(result, allow_nan=False)) == result


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"threshold": None}, "threshold: is missing"),
        ({"threshold": -0.1}, "threshold: is -0.1, expected at least 0"),
        ({"counter_bits": 0}, "counter_bits: is 0, expected at least 1"),
        ({"counter_bits": 65}, "counter_bits: is 65, expected at most 64"),
        ({"max_rate_pps": 0}, "max_rate_pps: is 0, expected more than 0"),
        ({"compare_basis": "relative"}, "compare_basis: is 'relative', expected 'raw' or 'normalised'"),
        ({"reference_policy": "seed"}, "reference_policy: is 'seed', expected 'claim' or 'embodiment'"),
        ({"runs": {}}, "runs: "),
        ({"runs": {"up_1g": {"kind": "gravity"}}}, "runs.up_1g: has no level; give a_g, tilt_deg, or I_mA with K1"),
        ({"runs": {"up_1g": {"kind": "source", "I_mA": 1.13}}}, "runs.up_1g: has no level; give a_g, tilt_deg, or"),
        (
            {"runs": {"up_1g": {"kind": "source", "a_g": 1, "I_mA": 13.56, "K1_mA_per_g": 1.13}}},
            "runs.up_1g: has more than one level: 1 g, 12 g",
        ),
        ({"runs": {"up_1g": {"kind": "source", "I_mA": 1, "K1_mA_per_g": 0}}}, "runs.up_1g.K1_mA_per_g: is 0; a scale"),
        ({"runs": {"up_1g": {"kind": "rest", "a_g": 1}}}, "runs.up_1g.kind: is 'rest', expected 'gravity' or 'source'"),
        ({"reference_run": "up_1G"}, "reference_run: there is no run 'up_1G'; did you mean 'up_1g'?"),
        (
            {"reference_policy": "embodiment", "source_reference_run": "src"},
            "source_reference_run: there is no run 'src'; did you mean 'src_1g'?",
        ),
    ],
)
def test_bad_settings_are_refused_where_they_are_bad(tmp_path, settings, message):
    assert refusal(tmp_path, **settings).startswith(f"case.json: settings.{message}")


def test_a_source_reference_that_nobody_asks_for_may_be_missing(tmp_path):
    result = reduce_case(write_case(tmp_path, {}, SETTINGS | {"source_reference_run": "none"}))
    assert result["deviation"]["src_12g"]["reference"] == "up_1g"


def test_one_level_in_two_ways_is_one_level():
    assert RunSettings(kind="source", a_g=12, I_mA=13.56, K1_mA_per_g=1.13).level_g == 12


def test_a_bad_cell_is_refused_where_it_is_bad(tmp_path):
    path = write_case(tmp_path, {})
    (tmp_path / "channel.csv").write_text("run,t_s,cum_pos,cum_neg,T_conv_C,T_acc_C\nup_1g,0,1;5,0,20,65\n")
    with pytest.raises(InputError, match=r"channel.csv: line 2, column cum_pos: '1;5' is not a number"):
        reduce_case(path)
    (tmp_path / "channel.csv").write_text("run,t_s,cum_pos,cum_neg,T_conv\n")
    with pytest.raises(
        InputError, match=r"channel.csv: line 1: there is no column 'T_conv_C'; if 'T_conv' is meant, rename it"
    ):
        reduce_case(path)


def test_counts_that_are_not_whole_are_named_and_left_out(tmp_path):
    header, rows = "run,t_s,cum_pos,cum_neg,T_conv_C,T_acc_C", range(100)
    path = write_case(tmp_path, {})
    (tmp_path / "channel.csv").write_text(
        "\n".join([header, *(f"up_1g,{i},{i * 10.25},0,{20 + i / 10},65" for i in rows)])
    )
    run = reduce_case(path)["runs"]["up_1g"]
    assert (run["D_ref_pps"], run["n_used"]) == (pytest.approx(10.25), 24)
    assert (run["rejected"]["fractional_count"], run["rejected"]["impossible_rate"]) == (75, 0)


def test_many_unknown_runs_are_named_in_part(tmp_path):
    path = write_case(tmp_path, {})
    rows = [f"{'long' * 20}{i},{i},0,0,20,65" for i in range(9)]
    (tmp_path / "channel.csv").write_text("\n".join(["run,t_s,cum_pos,cum_neg,T_conv_C,T_acc_C", *rows]) + "\n")
    result = reduce_case(path)
    assert result["rejected"] == {"no_run": 0, "unknown_run": 9}
    assert result["notes"][-1].endswith("long and 4 more")
    assert len(result["notes"][-1]) < 350


def test_a_deviation_is_marginal_by_its_expanded_uncertainty():
    run = replace(RUN, slope_per_c=0.15, u_slope_per_c=0.002)
    deviation = compare(run, RUN, threshold=0.3, basis="raw").raw
    near = deviation.value - 2.5 * deviation.u
    assert not compare(run, RUN, threshold=near, basis="raw").marginal
    few = replace(run, dof_slope=3)
    assert compare(few, replace(RUN, dof_slope=3), threshold=near, basis="raw").marginal


def test_a_level_in_another_unit_is_out_of_proportion_though_it_is_small():
    per_g = np.array([11_300.0, 11_300.0, 11_300.0])
    assert out_of_proportion(np.array([1.0, 0.577, 1e-3]), per_g * [1.0, 0.577, 1.0]).tolist() == [False, False, True]
    assert out_of_proportion(np.array([1.0, 0.577, 0.0]), per_g * [1.0, 0.577, 0.2]).tolist() == [False, False, False]
