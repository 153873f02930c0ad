"""Range cases of M3, made from a known sensor on a turning table, reduced and held against the truth."""

import numpy as np
import pytest

from bench.methods.rate_table.reduction.blocks import TableRecord
from bench.methods.rate_table.reduction.recorded_range import LinearityLimit, accelerometer_range, gyro_range
from bench.offline.case import reduce_case
from tests.support.m3_cases import G_MPS2, joined, shuffled, turning_block, write_case

COMMANDS = {"run1": 50.0, "run2": -50.0, "run10": 400.0, "run11": -400.0}
GYRO = {"commands_dps": COMMANDS, "k_m": 1e-3, "clip_dps": 450, "rate_tol": 1e-3, "full_scale_dps": 400}
ACC = {"g_mps2": G_MPS2, "range_g": 50, "k_m": 1e-3, "clip_g": 60}
LOW = {"low1": 120.0, "low2": 180.0, "low3": 240.0}
RUNS = {"run1": 800.0, "run2": 1794.0}


@pytest.fixture
def rng():
    return np.random.default_rng(20_240_303)


def gyro(rng, *, scale=1e-4, bias=0.02, level_dps=3e-3, turned=None, **changed):
    """Blocks of a gyro with a scale error; earth's rate seen across a tilted axis changes once a turn."""
    rates = {"bias": 0.0, **COMMANDS, **(turned or {})}
    return {
        phase: turning_block(
            rng, phase, rate, lambda angle, rate=rate: rate * (1 + scale) + bias + level_dps * np.cos(angle), **changed
        )
        for phase, rate in rates.items()
    }


def arm(rng, *, radius_m=0.5, square=0.0, bias=3e-3, level_g=5e-3, rates=None, **changed):
    """Blocks of an accelerometer on an arm; gravity comes in once a turn by the tilt of the axis."""
    noise = changed.pop("noise", 1e-3)

    def block(phase, rate):
        pull_g = np.radians(rate) ** 2 * radius_m / G_MPS2
        sensed_g = pull_g + square * pull_g**2 + bias
        wobble_g = level_g if rate else 0.0
        return turning_block(
            rng, phase, rate, lambda angle: sensed_g + wobble_g * np.sin(angle), name="acc_g", noise=noise, **changed
        )

    return {phase: block(phase, rate) for phase, rate in (rates or {"bias": 0.0, **LOW, **RUNS}).items()}


def reduced(tmp_path, sub, blocks, settings, *, change=lambda columns: columns):
    columns = change(joined(list(blocks.values()) if isinstance(blocks, dict) else blocks))
    return reduce_case(write_case(tmp_path, sub, settings, columns))


def point(result, phase):
    return next(each for each in result["points"] if each["phase"] == phase)


def test_gyro_errors_are_those_of_its_scale(tmp_path, rng):
    result = reduced(tmp_path, "gyro_range", gyro(rng), GYRO)
    assert list(result) == ["method", "sub", "bias_dps", "points", "passed", "flags", "notes", "rejected"]
    assert [each["phase"] for each in result["points"]] == ["run1", "run2", "run10", "run11"]
    assert list(result["points"][0]) == [
        "phase", "mean_dps", "table_dps", "error_dps", "rel_error", "passed", "marginal", "saturated", "stable",
    ]  # fmt: skip
    assert result["bias_dps"] == pytest.approx(0.02 + 3e-3 * np.cos(np.radians(31)), abs=2e-3)
    for each, rate in zip(result["points"], COMMANDS.values(), strict=True):
        assert each["table_dps"] == pytest.approx(rate, abs=2e-4)
        # The bias was taken at one angle of the table: earth's rate across the axis is still in it.
        assert each["error_dps"] == pytest.approx(1e-4 * rate, abs=5e-3)
        assert each["mean_dps"] == pytest.approx(rate * (1 + 1e-4) + 0.02, abs=3e-3)
        assert each["rel_error"] == pytest.approx(each["error_dps"] / each["table_dps"])
        assert (each["passed"], each["saturated"], each["stable"]) == (True, False, True)
    assert result["passed"] is True
    assert result["flags"] == []
    assert result["rejected"] == {"missing": 0, "duplicate": 0, "outlier": 0}


def test_gyro_beyond_its_linearity_fails_by_reading_and_passes_by_full_scale(tmp_path, rng):
    blocks = gyro(rng, scale=2e-3, turned={"run10": 100.0, "run11": -100.0})
    settings = GYRO | {"commands_dps": {"run1": 50, "run2": -50, "run10": 100, "run11": -100}}
    by_reading = reduced(tmp_path, "gyro_range", blocks, settings)
    assert by_reading["passed"] is False
    assert [each["passed"] for each in by_reading["points"]] == [False] * 4
    by_scale = reduced(tmp_path, "gyro_range", blocks, settings | {"linearity_basis": "full_scale"})
    assert by_scale["passed"] is True
    for by, basis in ((by_reading, [each["table_dps"] for each in by_reading["points"]]), (by_scale, [400] * 4)):
        for each, over in zip(by["points"], basis, strict=True):
            assert each["rel_error"] == pytest.approx(each["error_dps"] / over)
            assert each["passed"] == (abs(each["rel_error"]) <= settings["k_m"])
    assert [np.sign(each["rel_error"]) for each in by_scale["points"]] == [1, -1, 1, -1]


def test_gyro_at_its_clip_level_is_saturated_and_fails(tmp_path, rng):
    result = reduced(tmp_path, "gyro_range", gyro(rng, clip=399.99), GYRO | {"clip_dps": 399.99})
    assert [each["saturated"] for each in result["points"]] == [False, False, True, True]
    assert [each["passed"] for each in result["points"]] == [True, True, False, False]
    assert result["passed"] is False


def test_gyro_that_clips_most_of_the_time_fails_too(tmp_path, rng):
    blocks = gyro(rng)
    output = blocks["run10"]["out_dps"]
    output[:] = np.where(np.arange(len(output)) % 3 == 0, output, 400.0)
    result = reduced(tmp_path, "gyro_range", blocks, GYRO | {"clip_dps": 400.0})
    assert (point(result, "run10")["saturated"], point(result, "run10")["passed"]) == (True, False)
    assert (result["passed"], result["rejected"]["outlier"]) == (False, 0)


def test_a_time_stamp_far_away_is_no_block(tmp_path, rng):
    blocks = gyro(rng)
    blocks["run1"]["t_s"][17] = 1e30
    assert reduced(tmp_path, "gyro_range", blocks, GYRO)["flags"] == ["run1 invalid", "invalid"]


def test_table_that_did_not_turn_as_told_is_not_judged(tmp_path, rng):
    result = reduced(tmp_path, "gyro_range", gyro(rng, turned={"run2": -50.2}), GYRO)
    assert [each["stable"] for each in result["points"]] == [True, False, True, True]
    assert [each["passed"] for each in result["points"]] == [True, None, True, True]
    assert result["passed"] is None
    assert result["flags"] == ["invalid"]
    assert point(result, "run2")["error_dps"] == pytest.approx(-50.2e-4, abs=5e-3)


def test_an_error_about_its_limit_is_marginal(tmp_path, rng):
    result = reduced(tmp_path, "gyro_range", gyro(rng, scale=1e-3, level_dps=0.0, noise=0.1), GYRO)
    assert point(result, "run1")["marginal"] or point(result, "run2")["marginal"]
    assert result["flags"] == []
    assert result["notes"] == [
        f"{each['phase']} is marginal: its limit is within the expanded uncertainty of its error"
        for each in result["points"] if each["marginal"]
    ]  # fmt: skip
    assert result["passed"] == all(each["passed"] for each in result["points"])


def test_order_repeats_blanks_and_glitches_change_little(tmp_path, rng):
    blocks = gyro(rng)
    expected = reduced(tmp_path, "gyro_range", blocks, GYRO)
    record = joined(list(blocks.values()))
    found = reduced(tmp_path, "gyro_range", [shuffled(record, rng)], GYRO)
    assert found["rejected"]["duplicate"] == -(-len(record["t_s"]) // 7)
    for key in ("mean_dps", "table_dps", "error_dps"):
        assert [p[key] for p in found["points"]] == pytest.approx([p[key] for p in expected["points"]], abs=1e-9)
    hurt = {name: column.copy() for name, column in record.items()}
    hurt["out_dps"][::50] = np.nan
    hurt["out_dps"][7::60] = 1e30
    hurt["out_dps"][8::997] = 1e300
    hurt["enc_deg"][9::61] += 1e6
    found = reduced(tmp_path, "gyro_range", [hurt], GYRO)
    assert found["flags"] == []
    assert found["rejected"]["outlier"] > 40
    assert found["rejected"]["missing"] > 40
    for got, want in zip(found["points"], expected["points"], strict=True):
        assert got["error_dps"] == pytest.approx(want["error_dps"], abs=3e-3)


def test_a_mean_over_whole_turns_is_free_of_what_comes_once_a_turn(rng):
    block = turning_block(rng, "run1", 171.0, lambda angle: 171 + 5 * np.cos(angle), noise=0.0)  # 1.9 turns
    still = turning_block(rng, "bias", 0.0, lambda angle: 0 * angle, noise=0.0)
    columns = joined([still, block])
    record = TableRecord(*(columns[name] for name in ("phase", "t_s", "enc_deg", "out_dps")))
    result = gyro_range(record, {"run1": 171.0}, LinearityLimit(1e-3))
    assert result.points[0].turning.steady.output == pytest.approx(171, abs=0.03)
    assert abs(np.mean(block["out_dps"]) - 171) > 0.2


def test_a_run_that_is_missing_or_too_short_leaves_no_verdict(tmp_path, rng):
    blocks = gyro(rng)
    del blocks["run10"]
    result = reduced(tmp_path, "gyro_range", blocks, GYRO)
    assert result["flags"] == ["run10 invalid", "invalid"]
    assert [each["phase"] for each in result["points"]] == ["run1", "run2", "run11"]
    assert result["passed"] is None
    blocks = gyro(rng)
    blocks["run1"]["out_dps"][: len(blocks["run1"]["out_dps"]) // 2 + 1] = np.nan
    assert reduced(tmp_path, "gyro_range", blocks, GYRO)["flags"] == ["run1 invalid", "invalid"]
    short = {phase: {name: column[:2] for name, column in block.items()} for phase, block in gyro(rng).items()}
    result = reduced(tmp_path, "gyro_range", short, GYRO)
    assert (result["bias_dps"], result["points"], result["passed"]) == (None, [], None)


def test_too_many_glitches_leave_no_verdict(tmp_path, rng):
    blocks = gyro(rng)
    blocks["run2"]["out_dps"][::8] += 50
    result = reduced(tmp_path, "gyro_range", blocks, GYRO)
    assert result["flags"] == ["run2 invalid", "invalid"]


def test_without_a_bias_there_are_no_errors(tmp_path, rng):
    blocks = gyro(rng)
    del blocks["bias"]
    result = reduced(tmp_path, "gyro_range", blocks, GYRO)
    assert result["flags"] == ["bias invalid", "invalid"]
    assert result["bias_dps"] is None
    assert [each["error_dps"] for each in result["points"]] == [None] * 4
    assert result["points"][0]["table_dps"] == pytest.approx(50, abs=1e-3)
    assert result["passed"] is None


def test_a_bias_needs_no_encoder_and_may_be_coarse(tmp_path, rng):
    blocks = gyro(rng, noise=0.0)
    blocks["bias"]["enc_deg"][:] = np.nan
    # 70 % of the readings are one count, the rest the next: the median has no scatter.
    blocks["bias"]["out_dps"] = np.where(rng.uniform(size=400) < 0.7, 0.02, 0.03)
    result = reduced(tmp_path, "gyro_range", blocks, GYRO)
    assert result["bias_dps"] == pytest.approx(0.023, abs=1e-3)
    assert result["rejected"]["outlier"] == 0
    assert result["passed"] is True


def test_an_encoder_in_radians_is_no_stable_table(tmp_path, rng):
    blocks = gyro(rng)
    for block in blocks.values():
        block["enc_deg"] = np.radians(block["enc_deg"])
    result = reduced(tmp_path, "gyro_range", blocks, GYRO)
    assert not any(each["stable"] for each in result["points"])
    assert result["passed"] is None


def test_accelerometer_on_its_arm(tmp_path, rng):
    result = reduced(tmp_path, "acc_range", arm(rng), ACC)
    assert list(result) == [
        "method", "sub", "bias_g", "radius_m", "u_radius_m", "points", "passed", "flags", "notes", "rejected",
    ]  # fmt: skip
    assert list(result["points"][0]) == [
        "phase", "a_meas_g", "a_true_g", "rate_dps", "rel_error", "passed", "marginal", "saturated",
    ]  # fmt: skip
    assert result["bias_g"] == pytest.approx(3e-3, abs=2e-4)
    assert result["radius_m"] == pytest.approx(0.5, abs=4 * result["u_radius_m"])
    assert 1e-5 < result["u_radius_m"] < 4e-4
    for each, rate in zip(result["points"], RUNS.values(), strict=True):
        true_g = np.radians(rate) ** 2 * 0.5 / G_MPS2
        assert each["a_true_g"] == pytest.approx(true_g, rel=3e-4)
        assert each["a_meas_g"] == pytest.approx(true_g, abs=3e-4)
        assert each["rel_error"] == pytest.approx((each["a_meas_g"] - each["a_true_g"]) / ACC["range_g"])
        assert each["passed"] is True
    assert result["passed"] is True
    assert result["flags"] == []


@pytest.mark.parametrize(("rate_dps", "acceleration_g"), [(802, 10), (1135, 20), (1794, 50), (2160, 72.5)])
def test_printed_figures_of_the_centrifuge(tmp_path, rng, rate_dps, acceleration_g):
    rates = {"bias": 0.0, **LOW, "run1": float(rate_dps)}
    result = reduced(tmp_path, "acc_range", arm(rng, rates=rates, noise=0.0), ACC | {"g_mps2": 9.80665})
    true_g = result["points"][0]["a_true_g"]
    assert true_g * result["radius_m"] ** -1 * 0.5 == pytest.approx(acceleration_g, rel=1.5e-3)


def test_an_axis_away_from_the_spindle_has_a_negative_radius(tmp_path, rng):
    result = reduced(tmp_path, "acc_range", arm(rng, radius_m=-0.48), ACC)
    assert result["radius_m"] == pytest.approx(-0.48, abs=4 * result["u_radius_m"])
    assert result["points"][1]["a_true_g"] < 0
    assert result["passed"] is True


def test_errors_on_the_arm_are_relative_to_what_the_limit_is_a_fraction_of(tmp_path, rng):
    blocks = arm(rng, radius_m=-0.48, square=3e-5)
    by_scale = reduced(tmp_path, "acc_range", blocks, ACC)["points"]
    by_reading = reduced(tmp_path, "acc_range", blocks, ACC | {"linearity_basis": "reading"})["points"]
    for scaled, read in zip(by_scale, by_reading, strict=True):
        error_g = scaled["a_meas_g"] - scaled["a_true_g"]
        assert scaled["rel_error"] == pytest.approx(error_g / 50, rel=1e-6)
        assert read["rel_error"] == pytest.approx(error_g / read["a_true_g"], rel=1e-6)


def test_a_square_term_shows_at_full_range(tmp_path, rng):
    result = reduced(tmp_path, "acc_range", arm(rng, square=3e-5), ACC)
    at_50_g = result["points"][1]
    assert at_50_g["a_meas_g"] - at_50_g["a_true_g"] == pytest.approx(3e-5 * 50**2, rel=0.1)
    assert result["passed"] is False
    assert reduced(tmp_path, "acc_range", arm(rng, square=3e-5), ACC | {"k_m": 2e-3})["passed"] is True


def test_a_scale_in_other_units_is_in_the_radius_alone(tmp_path, rng):
    blocks = arm(rng)
    for block in blocks.values():
        block["acc_g"] = block["acc_g"] * G_MPS2
    result = reduced(tmp_path, "acc_range", blocks, ACC | {"range_g": 500, "clip_g": 600})
    assert result["radius_m"] == pytest.approx(0.5 * G_MPS2, rel=1e-3)
    assert result["points"][1]["rel_error"] == pytest.approx(0, abs=1e-3)


def test_saturation_on_the_arm_fails(tmp_path, rng):
    result = reduced(tmp_path, "acc_range", arm(rng, clip=45.0), ACC | {"clip_g": 45})
    assert [each["saturated"] for each in result["points"]] == [False, True]
    assert result["passed"] is False


@pytest.mark.parametrize(
    ("rates", "flags"),
    [
        ({"bias": 0.0, "low1": 200.0, **RUNS}, ["too_few_low_rates", "invalid"]),
        ({"bias": 0.0, **RUNS}, ["too_few_low_rates", "invalid"]),
        ({**LOW, **RUNS}, ["bias invalid", "invalid"]),
        ({"bias": 0.0, **LOW}, ["invalid"]),
        ({"bias": 0.0, "low1": 1.0, "low2": 1.5, **RUNS}, ["radius_not_determined", "invalid"]),
    ],
)
def test_what_the_arm_needs(tmp_path, rng, rates, flags):
    result = reduced(tmp_path, "acc_range", arm(rng, rates=rates, level_g=0.0), ACC)
    assert result["flags"] == flags
    assert result["passed"] is None
    assert (result["radius_m"] is None) == (flags[0] == "bias invalid" or "low1" not in rates)


@pytest.mark.parametrize("form", ["{!r}", "{:.12g}", "{:.9g}", "{:.6f}"])
@pytest.mark.parametrize(("start_s", "start_deg", "rate_dps"), [(95.0, 0.0, 10.0), (0.0, 9e4, 1400.0)])
def test_the_rounding_of_a_print_is_no_outlier(form, start_s, start_deg, rate_dps):
    time_s = np.arange(970) / 97
    phases = {"bias": 0.0 * time_s, "run1": rate_dps * time_s + start_deg}
    columns = [
        np.repeat(list(phases), len(time_s)), np.tile(time_s + start_s, 2), np.concatenate(list(phases.values())),
        np.repeat([0.01, 0.01 + rate_dps], len(time_s)),
    ]  # fmt: skip
    printed = [np.array([float(form.format(value)) for value in column.tolist()]) for column in columns[1:]]
    found = gyro_range(TableRecord(columns[0], *printed), {"run1": rate_dps}, LinearityLimit(1e-3))
    assert (found.passed, found.excluded["outlier"]) == (True, 0)
    assert found.points[0].turning.steady.rate_dps == pytest.approx(rate_dps, rel=1e-5)


def test_gravity_that_is_not_given_is_normal_gravity_at_the_site(tmp_path, rng):
    blocks = arm(rng)
    settings = {key: value for key, value in ACC.items() if key != "g_mps2"}
    normal = reduced(tmp_path, "acc_range", blocks, settings | {"g_mps2": None, "clip_g": None})
    assert normal["notes"] == ["g_mps2 is not given; normal gravity at the site is taken, 9.795406 m/s²"]
    given = reduced(tmp_path, "acc_range", blocks, settings | {"g_mps2": 9.7954060871})
    assert normal["radius_m"] == pytest.approx(given["radius_m"], rel=1e-10)
    assert (given["notes"], given["passed"]) == ([], True)


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_uncertainties_of_the_arm_are_as_large_as_the_errors():
    rng = np.random.default_rng(8)
    errors = []
    for _ in range(200):
        rates = {"bias": 0.0, "low1": 160.0, "low2": 240.0, "run1": 1794.0}
        columns = joined(list(arm(rng, rates=rates, noise=0.05, seconds=2.3).values()))
        record = TableRecord(*(columns[name] for name in ("phase", "t_s", "enc_deg", "acc_g")))
        found = accelerometer_range(record, G_MPS2, LinearityLimit(1e-3, 50))
        radius = (found.radius_m - 0.5) / found.u_radius_m
        errors.append([radius, *(each.error.value / each.error.u for each in found.points)])
    assert rms(errors) == pytest.approx([1, 1], abs=0.15)


def test_uncertainties_of_a_gyro_are_as_large_as_the_errors():
    rng = np.random.default_rng(9)
    errors = []
    commands = {"run1": -360.0}
    for _ in range(200):
        blocks = [
            turning_block(
                rng,
                "bias",
                0.0,
                lambda angle: 0.02 + 0 * angle,
            )
        ]
        for phase, rate in commands.items():
            blocks.append(
                turning_block(
                    rng,
                    phase,
                    rate,
                    lambda angle, rate=rate: rate + 0.02 + 0 * angle,
                )
            )
        columns = joined(blocks)
        record = TableRecord(*(columns[name] for name in ("phase", "t_s", "enc_deg", "out_dps")))
        found = gyro_range(record, commands, LinearityLimit(1e-3))
        errors.append(found.points[0].error.value / found.points[0].error.u)
    assert rms(errors) == pytest.approx(1, abs=0.15)


def test_samples_at_always_one_angle_have_a_plain_mean(rng):
    blocks = [
        turning_block(rng, phase, rate, lambda angle, rate=rate: rate + 0 * angle, sample_hz=6.0)
        for phase, rate in (("bias", 0.0), ("run1", 2160.0))  # six turns and six samples a second
    ]
    columns = joined(blocks)
    record = TableRecord(*(columns[name] for name in ("phase", "t_s", "enc_deg", "out_dps")))
    result = gyro_range(record, {"run1": 2160.0}, LinearityLimit(1e-3))
    assert result.points[0].error.value == pytest.approx(0, abs=0.02)
    assert result.passed is True


@pytest.mark.parametrize("sub", ["gyro_range", "acc_range"])
def test_a_frozen_sensor_has_no_verdict(tmp_path, rng, sub):
    """From the second of two low rates on it says the same, of which no rate alone could be told."""
    name, settings = ("out_dps", GYRO) if sub == "gyro_range" else ("acc_g", ACC)
    blocks = gyro(rng) if sub == "gyro_range" else arm(rng)
    for phase in list(blocks)[2:4]:
        blocks[phase][name] = [blocks[list(blocks)[2]][name][0]] * len(blocks[phase][name])
    found = reduced(tmp_path, sub, blocks, settings)
    assert found["passed"] is None
    assert "implausible_output" in found["flags"]


def test_a_coarse_a_silent_and_a_saturated_sensor_are_not_frozen(tmp_path, rng):
    blocks = gyro(rng, turned={"run12": 420.0, "run13": 440.0})
    same = {"run1": 50.0, "bias": 0.0, "run12": 410.0, "run13": 410.0}
    for phase, value in same.items():
        blocks[phase]["out_dps"] = [value] * len(blocks[phase]["out_dps"])
    commands = {**COMMANDS, "run12": 420.0, "run13": 440.0}
    found = reduced(tmp_path, "gyro_range", blocks, {**GYRO, "clip_dps": 410, "commands_dps": commands})
    assert "implausible_output" not in found["flags"]


def test_a_sensor_with_coarse_steps_is_not_frozen(tmp_path, rng):
    """Steps of 0.5 g do not tell 0.22 g from 0.5 g, nor 1 g from another of it."""
    blocks = arm(rng, level_g=0.0, noise=1e-6, rates={"bias": 0.0, "low1": 170.0, "low2": 200.0, **RUNS})
    for columns in blocks.values():
        columns["acc_g"] = [round(2 * value) / 2 for value in columns["acc_g"]]
    assert "implausible_output" not in reduced(tmp_path, "acc_range", blocks, ACC)["flags"]
