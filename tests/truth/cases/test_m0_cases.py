"""Cases of M0, made from a known channel (equations 8.4, 8.5), reduced and held against the truth."""

import json

import numpy as np
import pytest

from bench.methods.channel.reduction.decision import channel_drift, compare
from bench.methods.channel.reduction.line import ChannelRecord, ChannelRules, reduce_run
from bench.offline.case import reduce_case
from tests.support.m0_cases import (
    COLUMNS,
    LEVELS_G,
    SET_C,
    SETTINGS,
    T_REF_C,
    Channel,
    campaign,
    ramp_c,
    run_columns,
    write_case,
)
from tests.support.m4_cases import lagging_c

SCALE = Channel(scale_per_c=1e-5, zero_pps=0.0)  # all of the drift in proportion to the level
OFFSET = Channel(scale_per_c=0.0, offset_pps_per_c=0.1)  # all of it the same at all levels
BOTH = Channel(scale_per_c=1e-5, offset_pps_per_c=0.01)
CLEAN = dict.fromkeys(
    ("missing", "fractional_count", "beyond_counter", "duplicate", "thermometer", "ambiguous_gap", "too_short",
     "impossible_rate", "saturated", "stuck", "accelerometer_temperature", "outlier"), 0,
)  # fmt: skip


@pytest.fixture
def rng():
    return np.random.default_rng(20_240_607)


def reduced(tmp_path, records, /, order=None, **settings):
    result = reduce_case(write_case(tmp_path, records, SETTINGS | settings, order=order))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    return result


def only(*names, **more):
    return {name: SETTINGS["runs"][name] for name in names} | more


def analysed(columns, **rules):
    record = ChannelRecord(*(columns[name] for name in COLUMNS))
    return reduce_run(record, ChannelRules(T_REF_C, **({"counter_bits": 32, "max_rate_pps": 256e3} | rules)))


def assert_slopes_are_true(result, channel, levels_g=LEVELS_G, sigmas=4.5):
    for name, level_g in levels_g.items():
        run = result["runs"][name]
        assert run["k_pps_per_C"] == pytest.approx(channel.slope(level_g), abs=sigmas * run["u_k"])
        assert run["D_ref_pps"] == pytest.approx(channel.rate_pps(T_REF_C, level_g), abs=sigmas * run["u_D_ref"])


def test_a_good_channel_shares_its_model(tmp_path, rng):
    result = reduced(tmp_path, campaign(rng, SCALE))
    assert_slopes_are_true(result, SCALE)
    assert (result["flags"], result["notes"]) == ([], [])
    run = result["runs"]["up_1g"]
    assert run["a_g"] == 1
    assert run["n_used"] == 648
    assert run["rejected"] == CLEAN
    assert run["kappa_per_C"] == run["k_pps_per_C"] / run["D_ref_pps"]
    assert run["residual_rms_pps"] == pytest.approx(0.3, rel=0.1)
    assert run["span_C"] == pytest.approx(45, abs=0.1)
    assert run["ramp_C_per_h"] == pytest.approx(25, abs=0.05)
    assert {name: found["decision"] for name, found in result["deviation"].items()} == {
        "skew": "share", "src_1g": "share", "src_12g": "share",
    }  # fmt: skip
    assert not any(found["marginal"] for found in result["deviation"].values())
    far = result["deviation"]["src_12g"]
    assert far["final_c0"] == result["runs"]["src_12g"]["D_ref_pps"]
    assert far["final_k"] == pytest.approx(run["kappa_per_C"] * far["final_c0"])
    assert far["final_k"] != result["runs"]["src_12g"]["k_pps_per_C"]


def test_a_part_in_proportion_to_the_level_departs_raw_and_not_normalised(tmp_path, rng):
    # 42 % at g/√3 and 1100 % at 12 g although the converter is consistent: equations 2.5.
    result = reduced(tmp_path, campaign(rng, SCALE, noise_counts=0.5), compare_basis="raw")
    found = result["deviation"]
    assert found["skew"]["dk_raw"] == pytest.approx(0.42, abs=0.01)
    assert found["src_12g"]["dk_raw"] == pytest.approx(11.0, abs=0.1)
    assert found["src_12g"]["dk_norm"] == pytest.approx(0, abs=0.01)
    assert {name: deviation["decision"] for name, deviation in found.items()} == {
        "skew": "keep", "src_1g": "share", "src_12g": "keep",
    }  # fmt: skip
    assert found["src_1g"]["final_k"] == result["runs"]["up_1g"]["k_pps_per_C"]
    assert found["src_12g"]["final_k"] == result["runs"]["src_12g"]["k_pps_per_C"]
    assert found["src_12g"]["final_c0"] == result["runs"]["src_12g"]["D_ref_pps"]


def test_a_part_that_is_the_same_at_all_levels_departs_normalised_and_not_raw(tmp_path, rng):
    runs = campaign(rng, OFFSET, noise_counts=0.5)
    raw = reduced(tmp_path, runs, compare_basis="raw")["deviation"]
    assert {deviation["decision"] for deviation in raw.values()} == {"share"}
    normalised = reduced(tmp_path, runs)["deviation"]
    assert normalised["skew"]["dk_norm"] == pytest.approx(np.sqrt(3) - 1, abs=0.02)
    assert normalised["src_12g"]["dk_norm"] == pytest.approx(11 / 12, abs=0.02)
    assert [normalised[name]["decision"] for name in ("skew", "src_1g", "src_12g")] == ["keep", "share", "keep"]


def test_figures_are_those_of_independent_arithmetic(tmp_path, rng):
    runs = campaign(rng, BOTH)
    result = reduced(tmp_path, runs)
    slope, u_slope, rate = {}, {}, {}
    for name, columns in runs.items():
        pulses = np.diff(columns["cum_pos"])
        pulses[pulses < 0] += 2.0**32
        temperature_c = (columns["T_conv_C"][1:] + columns["T_conv_C"][:-1]) / 2
        (k, d), covariance = np.polyfit(temperature_c - T_REF_C, pulses / 10.0, 1, cov=True)
        slope[name], rate[name], u_slope[name] = k, d, np.sqrt(covariance[0, 0])
        run = result["runs"][name]
        assert [run["k_pps_per_C"], run["D_ref_pps"]] == pytest.approx([k, d], rel=1e-8)
        assert [run["u_k"], run["u_D_ref"]] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-8)
        residual = pulses / 10.0 - d - k * (temperature_c - T_REF_C)
        assert run["residual_rms_pps"] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-8)
    for name in ("skew", "src_1g", "src_12g"):
        found = result["deviation"][name]
        k, other, u, u_other = slope["up_1g"], slope[name], u_slope["up_1g"], u_slope[name]
        kappa, other_kappa = k / rate["up_1g"], other / rate[name]
        assert found["dk_raw"] == pytest.approx(abs((other - k) / k), rel=1e-6)
        assert found["u_dk_raw"] == pytest.approx(np.sqrt((u_other / k) ** 2 + (other * u / k**2) ** 2), rel=1e-6)
        assert found["dk_norm"] == pytest.approx(abs((other_kappa - kappa) / kappa), rel=1e-6)
        relative = np.sqrt((u_other / other) ** 2 + (u / k) ** 2)
        assert found["u_dk_norm"] == pytest.approx(abs(other_kappa / kappa) * relative, rel=1e-6)
        assert found["dk_abs_pps_per_C"] == pytest.approx(abs(other - k), rel=1e-6)
        assert found["dkappa_abs_per_C"] == pytest.approx(abs(other_kappa - kappa), rel=1e-6)
    rates, slopes, weights = (np.array(list(x.values())) for x in (rate, slope, u_slope))
    (alpha, beta), covariance = np.polyfit(rates, slopes, 1, w=1 / weights, cov="unscaled")
    assert [result["channel"][key] for key in ("tempco_offset_pps_per_C", "tempco_scale_per_C")] == pytest.approx(
        [beta, alpha], rel=1e-6
    )
    u_alpha, u_beta = np.sqrt(np.diag(covariance))
    assert result["channel"]["u_tempco_scale_per_C"] == pytest.approx(u_alpha, rel=1e-6)
    assert result["channel"]["u_tempco_offset_pps_per_C"] == pytest.approx(u_beta, rel=1e-6)


def test_embodiment_compares_sources_with_a_source(tmp_path, rng):
    runs = campaign(rng, BOTH)
    claim = reduced(tmp_path, runs)["deviation"]
    assert {name: found["reference"] for name, found in claim.items()} == {
        "skew": "up_1g", "src_1g": "up_1g", "src_12g": "up_1g",
    }  # fmt: skip
    embodiment = reduced(tmp_path, runs, reference_policy="embodiment")["deviation"]
    assert {name: found["reference"] for name, found in embodiment.items()} == {
        "skew": "up_1g", "src_1g": "up_1g", "src_12g": "src_1g",
    }  # fmt: skip
    assert embodiment["skew"] == claim["skew"]
    assert embodiment["src_12g"]["dk_norm"] != claim["src_12g"]["dk_norm"]


def test_the_two_parts_of_the_drift_are_told_apart(tmp_path, rng):
    result = reduced(tmp_path, campaign(rng, BOTH))
    found = result["channel"]
    # The same at all levels is what the rate would be without input: β and, of the zero, nothing.
    alpha = BOTH.slope(1) - 0.01  # S0 α I
    scale = alpha / (BOTH.rate_pps(T_REF_C, 1) - BOTH.rate_pps(T_REF_C, 0))
    assert found["tempco_scale_per_C"] == pytest.approx(scale, abs=4 * found["u_tempco_scale_per_C"])
    offset = 0.01 - scale * BOTH.rate_pps(T_REF_C, 0)
    assert found["tempco_offset_pps_per_C"] == pytest.approx(offset, abs=4 * found["u_tempco_offset_pps_per_C"])
    assert found["tempco_offset_pps_per_C"] == pytest.approx(0.01, abs=0.004)
    assert result["notes"] == []


def test_a_drift_that_depends_on_the_level_otherwise_does_not_fit(tmp_path, rng):
    result = reduced(tmp_path, campaign(rng, Channel(nonlinear=0.5)))
    assert result["notes"] == [
        "channel: the slopes are not an offset and a part in proportion to the level: the drift is not linear"
    ]


def test_levels_that_are_alike_do_not_tell_the_parts_apart(tmp_path, rng):
    names = ("up_1g", "src_1g")
    runs = {name: run_columns(rng, BOTH, 1.0) for name in names}
    result = reduced(tmp_path, runs, runs=only(*names))
    assert result["channel"]["tempco_scale_per_C"] is None
    assert result["channel"]["tempco_offset_pps_per_C"] is None
    assert result["flags"] == ["ill_conditioned"]
    assert "tempco_offset and tempco_scale are not determined" in result["notes"][0]


def test_one_run_has_nothing_to_be_compared_with(tmp_path, rng):
    result = reduced(tmp_path, {"up_1g": run_columns(rng, BOTH, 1.0)}, runs=only("up_1g"))
    assert result["deviation"] == {}
    assert set(result["channel"].values()) == {None}
    assert (result["flags"], result["notes"]) == ([], [])


def test_counters_that_wrap_count_on(tmp_path, rng):
    seed = int(rng.integers(1000))
    wide = campaign(np.random.default_rng(seed), BOTH, bits=32)
    narrow = {
        name: columns | {key: columns[key] % 2.0**22 for key in ("cum_pos", "cum_neg")}
        for name, columns in wide.items()
    }
    assert np.sum(np.diff(narrow["src_12g"]["cum_pos"]) < 0) > 100
    expected = reduced(tmp_path, wide)
    assert reduced(tmp_path, narrow, counter_bits=22) == expected


def test_order_duplicates_and_strange_rows_change_nothing(tmp_path, rng):
    runs = campaign(rng, BOTH)
    expected = reduced(tmp_path, runs)
    rows = sum(len(columns["t_s"]) for columns in runs.values())
    others = {
        "": run_columns(rng, BOTH, 1.0, noise_counts=0) | {},
        "warm_up": run_columns(rng, BOTH, 3.0),
    }
    order = np.concatenate([rng.permutation(rows + 2 * 649), np.arange(0, rows, 7)])
    found = reduced(tmp_path, runs | others, order=order)
    for name in LEVELS_G:
        run, other = found["runs"][name], expected["runs"][name]
        # An equal row is the same row, whichever of the two is kept.
        assert run.pop("rejected")["duplicate"] in (92, 93)
        assert other.pop("rejected")["duplicate"] == 0
        assert run == other
    assert found["deviation"] == expected["deviation"]
    assert found["rejected"] == {"no_run": 649, "unknown_run": 649}
    assert found["notes"] == ["rows of runs not listed in settings.runs were ignored: warm_up"]


def test_of_readings_of_one_time_the_first_good_one_counts(tmp_path, rng):
    columns = run_columns(rng, BOTH, 1.0)
    doubled = {name: np.repeat(values, 2) for name, values in columns.items()}
    doubled["cum_pos"][1::2] += 500  # the second of each pair
    doubled["cum_pos"][0:40:4] = np.nan  # the first is not there
    doubled["cum_pos"][1:40:4] -= 500
    result = reduced(tmp_path, {"up_1g": doubled}, runs=only("up_1g"))
    plain = reduced(tmp_path, {"up_1g": columns}, runs=only("up_1g"))
    assert result["runs"]["up_1g"]["k_pps_per_C"] == plain["runs"]["up_1g"]["k_pps_per_C"]
    assert result["runs"]["up_1g"]["rejected"] == CLEAN | {"missing": 10, "duplicate": 639}


def test_a_gate_reaches_over_what_is_blank(tmp_path, rng):
    runs = campaign(rng, BOTH)
    for columns in runs.values():
        for key in ("cum_pos", "cum_neg", "T_conv_C"):
            columns[key][rng.choice(649, 60, replace=False)] = np.nan
    runs["src_12g"]["T_acc_C"][:] = np.nan  # no accelerometer, no thermometer
    runs["src_1g"]["T_acc_C"][:] = 20.0
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    for run in result["runs"].values():
        assert 150 < run["rejected"]["missing"] < 181
        assert run["n_used"] + sum(run["rejected"].values()) == 648
    assert result["flags"] == []


def test_a_run_with_most_readings_blank_is_invalid(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["skew"]["cum_pos"][rng.choice(649, 340, replace=False)] = np.nan
    result = reduced(tmp_path, runs)
    assert result["flags"] == ["skew:invalid"]
    assert result["runs"]["skew"]["flags"] == ["invalid"]
    assert result["deviation"]["skew"]["decision"] == "invalid"
    assert result["deviation"]["skew"]["final_k"] is None
    assert result["deviation"]["src_12g"]["decision"] != "invalid"
    assert result["notes"] == [
        "skew: fewer than half of its gates could be used, 308 of 648",
        "skew: no decision: its own run is not valid",
    ]


def test_lost_and_extra_pulses_spoil_one_gate_each(tmp_path, rng):
    runs = campaign(rng, BOTH)
    expected = reduced(tmp_path, runs)
    glitches = {"up_1g": ((100, 200), (300, -150), (500, 90_000)), "src_12g": ((40, -70),)}
    for name, places in glitches.items():
        for reading, pulses in places:
            runs[name]["cum_pos"][reading:] += pulses
        runs[name]["cum_pos"] %= 2.0**32
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    assert [result["runs"][name]["rejected"]["outlier"] for name in LEVELS_G] == [3, 0, 0, 1]
    assert result["runs"]["up_1g"]["n_used"] == 645
    assert result["runs"]["up_1g"]["k_pps_per_C"] == pytest.approx(expected["runs"]["up_1g"]["k_pps_per_C"], rel=0.01)
    assert result["flags"] == []


def test_too_many_outliers_are_not_dropped_in_silence(tmp_path, rng):
    runs = campaign(rng, BOTH)
    steps = np.zeros(649)
    steps[rng.choice(np.arange(1, 649), 75, replace=False)] = 3000
    runs["src_1g"]["cum_pos"] += np.cumsum(steps)
    runs["src_1g"]["cum_pos"] %= 2.0**32
    result = reduced(tmp_path, runs)
    assert result["flags"] == ["src_1g:invalid"]
    assert result["notes"][0] == "src_1g: too many outliers, 75 of 648 gates"
    assert result["deviation"]["src_1g"]["decision"] == "invalid"
    assert reduced(tmp_path, runs, reference_policy="embodiment")["deviation"]["src_12g"]["decision"] == "invalid"


def test_stuck_and_restarted_counters_spoil_their_gates_only(tmp_path, rng):
    runs = campaign(rng, BOTH)
    up, skew = runs["up_1g"]["cum_pos"], runs["skew"]
    up[200:221] = up[200]  # stands for 20 gates, then leaps to where it should be
    restart = skew["cum_pos"][400]
    for key in ("cum_pos", "cum_neg"):
        skew[key][400:] -= skew[key][400]
    skew["cum_pos"] %= 2.0**32
    assert restart > 0
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    assert result["runs"]["up_1g"]["rejected"] == CLEAN | {"stuck": 20, "outlier": 1}
    assert result["runs"]["up_1g"]["n_used"] == 627
    assert result["runs"]["skew"]["rejected"] == CLEAN | {"impossible_rate": 1}
    assert result["flags"] == []


def test_a_counter_that_never_moves_is_no_slope_of_nothing(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["src_12g"]["cum_pos"][:] = 77.0
    result = reduced(tmp_path, runs, compare_basis="raw")
    run = result["runs"]["src_12g"]
    assert (run["D_ref_pps"], run["k_pps_per_C"], run["n_used"]) == (None, None, 0)
    assert run["rejected"] == CLEAN | {"stuck": 648}
    assert result["flags"] == ["src_12g:invalid"]
    assert result["deviation"]["src_12g"]["decision"] == "invalid"
    assert result["deviation"]["src_12g"]["dk_raw"] is None


def test_a_saturated_converter_is_no_channel_without_drift(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["src_12g"]["cum_pos"] = np.floor(100_000.0 * runs["src_12g"]["t_s"] + 0.3)
    result = reduced(tmp_path, runs, max_rate_pps=100_000)
    assert result["runs"]["src_12g"]["rejected"] == CLEAN | {"saturated": 648}
    assert result["deviation"]["src_12g"]["decision"] == "invalid"


def test_rows_that_were_dropped_are_not_guessed(tmp_path, rng):
    # 24 bit go round in 65.5 s at the highest rate: over six gates, not over seven.
    columns = run_columns(rng, BOTH, 12.0, bits=24)
    kept = np.ones(649, dtype=bool)
    kept[100:105] = kept[300:306] = kept[500:530] = False
    runs = {"up_1g": {key: values[kept] for key, values in columns.items()}}
    result = reduced(tmp_path, runs, counter_bits=24, runs=only("up_1g"))
    run = result["runs"]["up_1g"]
    assert run["rejected"] == CLEAN | {"ambiguous_gap": 2}
    assert run["n_used"] == 649 - 41 - 1 - 2
    assert_slopes_are_true(result, BOTH, {"up_1g": 12.0})


def test_the_accelerometer_away_from_its_temperature(tmp_path, rng):
    runs = campaign(rng, BOTH)
    for name, gates in (("up_1g", 30), ("skew", 80), ("src_1g", 400)):
        columns, start = runs[name], 100
        columns["T_acc_C"][start : start + gates] += 1.0
        spoiled = np.zeros(649)
        spoiled[start : start + gates] = 6.0  # 53 ppm of the scale factor for 1 °C
        if name != "src_1g":
            columns["cum_pos"] = (columns["cum_pos"] + np.cumsum(spoiled)) % 2.0**32
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    away = [result["runs"][name]["rejected"]["accelerometer_temperature"] for name in LEVELS_G]
    assert away == [31, 81, 0, 0]  # a gate before and a gate behind have half of the excursion
    assert result["flags"] == []
    assert result["notes"] == [
        "skew: the accelerometer was not at its temperature in 81 of 648 gates; that should end a run"
    ]
    # Nothing is known of the thermostat: nothing is looked at.
    unknown = reduced(tmp_path, runs, acc_temp_set_C=None)["runs"]["up_1g"]
    assert unknown["rejected"]["accelerometer_temperature"] == 0


def test_the_limit_of_the_accelerometers_temperature_is_within_it(tmp_path, rng):
    columns = run_columns(rng, BOTH, 1.0)
    columns["T_acc_C"][:] = 65.2  # 65.2 - 65 is more than 0.2 to a computer
    run = reduced(tmp_path, {"up_1g": columns}, runs=only("up_1g"))["runs"]["up_1g"]
    assert run["n_used"] == 648


def test_an_open_thermometer_and_jumps_of_it(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["up_1g"]["T_conv_C"][[50, 51, 300]] = 850.0
    runs["skew"]["T_conv_C"][[10, 640]] += 8.0
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    assert [result["runs"][name]["rejected"]["thermometer"] for name in LEVELS_G] == [3, 2, 0, 0]
    assert [result["runs"][name]["n_used"] for name in LEVELS_G] == [645, 646, 648, 648]


def test_a_span_that_is_too_small_decides_nothing(tmp_path, rng):
    time_s, converter_c = ramp_c(low_c=20, high_c=24.5)
    runs = campaign(rng, SCALE) | {"skew": run_columns(rng, SCALE, 0.577, time_s=time_s, converter_c=converter_c)}
    result = reduced(tmp_path, runs)
    assert result["flags"] == ["skew:insufficient_temperature_span"]
    assert result["runs"]["skew"]["flags"] == ["insufficient_temperature_span"]
    assert result["runs"]["skew"]["k_pps_per_C"] is not None
    assert result["deviation"]["skew"]["decision"] == "invalid"
    assert result["deviation"]["skew"]["dk_norm"] is not None
    assert result["deviation"]["src_12g"]["decision"] == "share"
    assert result["notes"] == ["skew: no decision: its own run is not valid"]
    # The reference of all others.
    runs["up_1g"] = run_columns(rng, SCALE, 1.0, time_s=time_s, converter_c=converter_c)
    result = reduced(tmp_path, runs)
    assert {found["decision"] for found in result["deviation"].values()} == {"invalid"}
    assert "src_1g: no decision: the run it is compared with is not valid" in result["notes"]


@pytest.mark.parametrize(("c_per_h", "too_fast"), [(30.5, False), (30.7, True), (-30.7, True)])
def test_a_ramp_above_its_limit_is_flagged(tmp_path, rng, c_per_h, too_fast):
    ends = {"low_c": 10, "high_c": 55} if c_per_h > 0 else {"low_c": 55, "high_c": 10}
    time_s, converter_c = ramp_c(**ends, c_per_h=abs(c_per_h))
    runs = campaign(rng, SCALE) | {"src_1g": run_columns(rng, SCALE, 1.0, time_s=time_s, converter_c=converter_c)}
    result = reduced(tmp_path, runs)
    assert result["runs"]["src_1g"]["ramp_C_per_h"] == pytest.approx(c_per_h, abs=0.05)
    assert result["flags"] == (["src_1g:ramp_too_fast"] if too_fast else [])
    assert result["deviation"]["src_1g"]["decision"] == "share"


def test_a_reference_without_a_slope_has_differences_only(tmp_path, rng):
    flat = Channel(scale_per_c=0.0, zero_pps=0.0)
    runs = campaign(rng, flat) | {"src_12g": run_columns(rng, SCALE, 12.0)}
    for basis in ("raw", "normalised"):
        result = reduced(tmp_path, runs, compare_basis=basis)
        reference, found = result["runs"]["up_1g"], result["deviation"]["src_12g"]
        assert abs(reference["k_pps_per_C"]) < 3 * reference["u_k"]
        assert [found[key] for key in ("dk_raw", "dk_norm", "u_dk_raw", "u_dk_norm")] == [None] * 4
        assert (found["decision"], found["marginal"], found["final_c0"], found["final_k"]) == (
            "invalid", False, None, None,
        )  # fmt: skip
        assert found["dk_abs_pps_per_C"] == pytest.approx(SCALE.slope(12.0), rel=0.02)
        assert found["dkappa_abs_per_C"] == pytest.approx(1e-5, rel=0.02)
        assert (
            "src_12g: no decision: the slope it is compared with is less than three times its uncertainty"
            in (result["notes"])
        )
    assert result["flags"] == []


def test_no_drift_and_no_noise_at_all_is_no_slope(tmp_path, rng):
    runs = campaign(rng, SCALE) | {"up_1g": run_columns(rng, Channel(scale_per_c=0.0), 1.0, noise_counts=0.0)}
    assert len(set(np.diff(runs["up_1g"]["cum_pos"]))) == 1  # 113 020 pulses in every gate
    result = reduced(tmp_path, runs)
    assert result["runs"]["up_1g"]["n_used"] == 648
    assert {found["decision"] for found in result["deviation"].values()} == {"invalid"}


def test_negative_input_has_its_own_slope(tmp_path, rng):
    channel = Channel(zero_pps=0.0, negative=1 - 3e-5)
    names = {"up_1g": 1.0, "down_1g": -1.0, "down_skew": -0.577}
    runs = {name: run_columns(rng, channel, level_g) for name, level_g in names.items()}
    listed = only(
        "up_1g", down_1g={"kind": "gravity", "tilt_deg": 180}, down_skew={"kind": "gravity", "a_g": -0.577}
    )  # fmt: skip
    result = reduced(tmp_path, runs, runs=listed)
    assert_slopes_are_true(result, channel, names)
    down = result["runs"]["down_1g"]
    assert down["a_g"] == -1
    assert down["D_ref_pps"] < 0
    assert down["kappa_per_C"] == pytest.approx(1e-5, rel=0.02)
    found = result["deviation"]["down_1g"]
    assert found["dk_norm"] < 0.05  # and it keeps its own all the same
    assert (found["decision"], found["marginal"], found["final_k"]) == ("keep", False, down["k_pps_per_C"])
    assert result["notes"][0] == (
        "down_1g: keeps its own model: at the other polarity the converter has another scale factor"
    )
    assert result["flags"] == []
    # Two runs of that polarity are compared with each other as any two.
    result = reduced(tmp_path, runs, runs=listed, reference_run="down_1g")
    assert result["deviation"]["down_skew"]["decision"] == "share"


def test_lag_moves_the_rate_and_not_the_slope(tmp_path, rng):
    # 5 min at 25 °C/h are 2 °C; steady ramp, the lag has settled before the record begins.
    time_s, thermometer_c = ramp_c()
    behind_c = 25 * 300 / 3600
    strong = Channel(scale_per_c=1e-4)
    rising = {
        "time_s": time_s, "converter_c": thermometer_c - behind_c, "thermometer_c": thermometer_c,
    }  # fmt: skip
    falling = {
        "time_s": time_s, "converter_c": thermometer_c[::-1] + behind_c, "thermometer_c": thermometer_c[::-1],
    }  # fmt: skip
    runs = {"up_1g": run_columns(rng, strong, 1.0, **rising), "cooling": run_columns(rng, strong, 1.0, **falling)}
    result = reduced(tmp_path, runs, runs=only("up_1g", cooling={"kind": "gravity", "a_g": 1}))
    up, down = result["runs"]["up_1g"], result["runs"]["cooling"]
    for run, sign in ((up, -1), (down, 1)):
        assert run["k_pps_per_C"] == pytest.approx(strong.slope(1), abs=4 * run["u_k"])
        shifted = strong.rate_pps(T_REF_C, 1) + sign * behind_c * strong.slope(1)
        assert run["D_ref_pps"] == pytest.approx(shifted, abs=4 * run["u_D_ref"])
    assert down["ramp_C_per_h"] == pytest.approx(-25, abs=0.05)
    assert result["deviation"]["cooling"]["decision"] == "share"


def test_up_and_down_again_cancels_the_lag(tmp_path, rng):
    time_s, rising_c = ramp_c()
    thermometer_c = np.concatenate([rising_c, rising_c[-2::-1]])
    time_s = 10.0 * np.arange(len(thermometer_c))
    strong = Channel(scale_per_c=1e-4)
    profile = {"time_s": time_s, "converter_c": lagging_c(time_s, thermometer_c, 300.0), "thermometer_c": thermometer_c}
    runs = {"up_1g": run_columns(rng, strong, 1.0, **profile)}
    run = reduced(tmp_path, runs, runs=only("up_1g"))["runs"]["up_1g"]
    # 2 °C of lag are 2.3 pulse/s; where the ramp turns it is not settled.
    assert run["D_ref_pps"] == pytest.approx(strong.rate_pps(T_REF_C, 1), abs=0.1)
    assert run["k_pps_per_C"] == pytest.approx(strong.slope(1), rel=0.02)
    assert run["ramp_C_per_h"] == pytest.approx(25, abs=0.05)
    assert run["flags"] == []


def test_soaks_at_the_ends_do_not_hide_a_ramp(tmp_path, rng):
    _, rising_c = ramp_c(c_per_h=40)
    thermometer_c = np.concatenate([np.full(100, 10.0), rising_c, np.full(100, 55.0)])
    time_s = 10.0 * np.arange(len(thermometer_c))
    runs = {"up_1g": run_columns(rng, BOTH, 1.0, time_s=time_s, converter_c=thermometer_c)}
    result = reduced(tmp_path, runs, runs=only("up_1g"))
    assert result["runs"]["up_1g"]["ramp_C_per_h"] == pytest.approx(40, abs=0.1)
    assert result["flags"] == ["up_1g:ramp_too_fast"]


def test_a_curve_is_followed_by_its_chord_and_nothing_is_dropped(tmp_path, rng):
    curved = Channel(scale_per_c=1e-5, scale_per_c2=2e-7)
    result = reduced(tmp_path, campaign(rng, curved, noise_counts=0.3))
    run = result["runs"]["up_1g"]
    assert run["rejected"] == CLEAN
    # Of a parabola over 10..55 °C the least-squares line has the slope in the middle, at 32.5 °C.
    assert run["k_pps_per_C"] == pytest.approx(11_300 * (1e-5 + 2 * 2e-7 * 7.5), rel=0.01)
    assert result["deviation"]["src_12g"]["decision"] == "share"


@pytest.mark.parametrize(("threshold", "marginal"), [(0.05, False), (0.9, False), (0.732, True)])
def test_a_deviation_at_the_threshold_is_marginal(tmp_path, rng, threshold, marginal):
    result = reduced(tmp_path, campaign(rng, OFFSET), threshold=threshold)  # 1/0.577351 - 1 = 0.732
    assert result["deviation"]["skew"]["marginal"] is marginal


@pytest.mark.parametrize("readings", [0, 1, 2, 3])
def test_too_few_rows(tmp_path, rng, readings):
    columns = {key: values[::60][:readings] for key, values in run_columns(rng, BOTH, 1.0).items()}
    result = reduced(tmp_path, campaign(rng, BOTH) | {"up_1g": columns}, min_span_C=0)
    run = result["runs"]["up_1g"]
    assert run["n_used"] == max(readings - 1, 0)
    assert (run["k_pps_per_C"] is None) == (readings < 3)
    assert run["u_k"] is None
    assert result["flags"] == ["up_1g:invalid"]
    assert {found["decision"] for found in result["deviation"].values()} == {"invalid"}


def test_a_constant_temperature_has_no_slope(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["up_1g"]["T_conv_C"][:] = 25.0
    result = reduced(tmp_path, runs)
    assert result["runs"]["up_1g"]["k_pps_per_C"] is None
    assert result["flags"] == ["up_1g:insufficient_temperature_span"]
    assert result["deviation"]["skew"]["decision"] == "invalid"


def test_milliseconds_for_seconds_and_kelvin_for_celsius_decide_nothing(tmp_path, rng):
    runs = campaign(rng, BOTH, bits=24)
    runs["skew"]["t_s"] *= 1000
    runs["src_1g"]["t_s"] /= 1000
    runs["src_12g"]["T_conv_C"] += 273.15
    result = reduced(tmp_path, runs, counter_bits=24)
    assert result["runs"]["skew"]["rejected"] == CLEAN | {"ambiguous_gap": 648}
    assert result["runs"]["src_1g"]["rejected"] == CLEAN | {"impossible_rate": 648}
    assert result["runs"]["src_12g"]["rejected"] == CLEAN | {"thermometer": 649}
    assert result["flags"] == [
        "skew:invalid", "src_1g:ramp_too_fast", "src_1g:invalid", "src_12g:invalid", "implausible_temperature",
    ]  # fmt: skip
    assert {found["decision"] for found in result["deviation"].values()} == {"invalid"}


def test_what_no_counter_shows_is_named_with_its_rows(tmp_path, rng):
    runs = campaign(rng, BOTH)
    runs["up_1g"]["cum_neg"][[4, 9]] -= 0.37  # falls by a part of a count, which no wrap does
    runs["skew"]["cum_pos"][7] += 2.0**32
    runs["src_1g"]["cum_neg"][3] = -1
    result = reduced(tmp_path, runs)
    assert result["flags"] == []
    assert result["runs"]["up_1g"]["rejected"] == CLEAN | {"fractional_count": 2}
    assert result["runs"]["skew"]["rejected"] == result["runs"]["src_1g"]["rejected"] == CLEAN | {"beyond_counter": 1}
    assert result["notes"] == [
        "channel.csv: counts with a fraction were left out: lines 6, 11",
        "channel.csv: counts that a counter of 32 bits does not show were left out: lines 658, 1303",
    ]


def test_a_current_in_another_unit_is_noticed(tmp_path, rng):
    runs = SETTINGS["runs"] | {"src_12g": {"kind": "source", "I_mA": 0.01356, "K1_mA_per_g": 1.13}}
    assert reduced(tmp_path, campaign(rng, SCALE), runs=runs)["notes"] == [
        "src_12g: 135607 pulse/s at 0.012 g is not proportional to the other runs"
    ]
    runs = SETTINGS["runs"] | {"src_12g": {"kind": "source", "I_mA": 13_560, "K1_mA_per_g": 1.13}}
    assert reduced(tmp_path, campaign(rng, SCALE), runs=runs)["notes"] == [
        "src_12g: 135607 pulse/s at 12000 g is not proportional to the other runs"
    ]


def test_an_axis_that_was_mounted_the_wrong_way_is_noticed(tmp_path, rng):
    runs = campaign(rng, SCALE) | {"skew": run_columns(rng, SCALE, -0.577)}
    result = reduced(tmp_path, runs)
    assert result["notes"][-1].startswith("skew: -6520.")
    assert result["deviation"]["skew"]["decision"] == "keep"


def test_numbers_without_measure_are_no_numbers(tmp_path, rng):
    runs = campaign(rng, BOTH)
    for i, value in enumerate([np.inf, -np.inf, 1e300, -1e300, 1.7e308]):
        for offset, key in enumerate(("cum_pos", "cum_neg", "T_conv_C", "T_acc_C")):
            runs["up_1g"][key][20 + 100 * i + 10 * offset] = value
    runs["up_1g"]["t_s"][[3, 7, 9]] = [np.inf, 1.7e308, -1.7e308]
    result = reduced(tmp_path, runs)
    assert_slopes_are_true(result, BOTH)
    assert result["runs"]["up_1g"]["n_used"] > 620
    assert result["flags"] == []


def test_readings_closer_than_a_pulse_tell_nothing(tmp_path, rng):
    runs = campaign(rng, BOTH)
    doubled = {name: np.repeat(values, 2) for name, values in runs["up_1g"].items()}
    doubled["t_s"][1::2] += 1e-6
    result = reduced(tmp_path, runs | {"up_1g": doubled})
    assert result["runs"]["up_1g"]["rejected"] == CLEAN | {"too_short": 649}
    assert_slopes_are_true(result, BOTH)


def test_equal_counts_in_most_gates_are_no_reason_to_drop_the_others(rng):
    # 1000 pulse/s exactly, every tenth gate a pulse more or less by the time of its latch.
    time_s, converter_c = ramp_c()
    counts = 10_000.0 * np.arange(649)
    counts[::10] += 1
    columns = {
        "t_s": time_s, "cum_pos": counts, "cum_neg": np.zeros(649), "T_conv_C": converter_c,
        "T_acc_C": np.full(649, SET_C),
    }  # fmt: skip
    assert analysed(columns).gates_used == 648
    columns["cum_pos"][300:] += 4  # more than a count can be wrong
    assert analysed(columns).excluded["outlier"] == 1


@pytest.fixture(scope="module")
def experiments():
    """200 campaigns with noise well above a count: slopes, deviations and drift."""
    rng = np.random.default_rng(7)
    time_s, converter_c = ramp_c(interval_s=40)
    channel = Channel(scale_per_c=1e-5, offset_pps_per_c=0.04, zero_pps=0.0)
    runs = [
        {name: analysed(columns) for name, columns in experiment.items()}
        for experiment in (
            campaign(rng, channel, time_s=time_s, converter_c=converter_c, noise_counts=20) for _ in range(200)
        )
    ]
    return channel, runs


def spread(error_over_u):
    return np.sqrt(np.mean(np.square(error_over_u)))


@pytest.mark.parametrize("name", LEVELS_G)
def test_the_uncertainty_of_slope_and_rate_is_their_scatter(experiments, name):
    channel, experiments = experiments
    runs = [experiment[name] for experiment in experiments]
    slope, rate_pps = channel.slope(LEVELS_G[name]), channel.rate_pps(T_REF_C, LEVELS_G[name])
    assert 0.85 < spread([(run.slope_per_c - slope) / run.u_slope_per_c for run in runs]) < 1.15
    assert 0.85 < spread([(run.rate - rate_pps) / run.u_rate for run in runs]) < 1.15


@pytest.mark.parametrize("basis", ["raw", "normalised"])
@pytest.mark.parametrize("name", ["skew", "src_12g"])
def test_the_uncertainty_of_a_deviation_is_its_scatter(experiments, name, basis):
    channel, experiments = experiments
    slope = {run: channel.slope(level_g) for run, level_g in LEVELS_G.items()}
    relative = {run: slope[run] / channel.rate_pps(T_REF_C, level_g) for run, level_g in LEVELS_G.items()}
    of = slope if basis == "raw" else relative
    truth = abs(of[name] / of["up_1g"] - 1)
    assert truth > 0.15
    found = [
        getattr(compare(runs[name], runs["up_1g"], threshold=0, basis=basis), basis) for runs in experiments
    ]  # fmt: skip
    assert 0.85 < spread([(deviation.value - truth) / deviation.u for deviation in found]) < 1.15


def test_the_uncertainty_of_the_drift_is_its_scatter(experiments):
    channel, experiments = experiments
    drifts = [channel_drift(list(runs.values())) for runs in experiments]
    scale = 1e-5 / (1 + 1e-5 * (T_REF_C - 25))  # at the reference temperature
    offset = 0.04 - scale * float(channel.rate_pps(T_REF_C, 0.0))
    assert 0.85 < spread([(drift.scale_per_c - scale) / drift.u_scale_per_c for drift in drifts]) < 1.15
    assert 0.85 < spread([(drift.offset_per_c - offset) / drift.u_offset_per_c for drift in drifts]) < 1.15
    assert np.mean([drift.misfit for drift in drifts]) < 0.03


def test_counting_alone_scatters_less_than_its_uncertainty(rng):
    # The errors of adjacent gates have opposite signs: equations 2.5.
    runs = [analysed(run_columns(rng, SCALE, 1.0, noise_counts=0.0)) for _ in range(100)]
    assert spread([(run.slope_per_c - SCALE.slope(1)) / run.u_slope_per_c for run in runs]) < 0.5
