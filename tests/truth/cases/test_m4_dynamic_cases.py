"""Dynamic cases of M4, made from a known accelerometer (equations 8.3, 8.4), reduced and held against the truth."""

import numpy as np
import pytest

from bench.offline.case import reduce_case
from tests.support.m4_cases import THRESHOLDS_C, lagging_c, play_g, ramps, shuffled, write_case

K1 = 1.13
UG = K1 * 1e-6  # V per µg


@pytest.fixture
def rng():
    return np.random.default_rng(20_240_607)


def reduced(tmp_path, columns, **settings):
    return reduce_case(write_case(tmp_path, "dynamic", settings, columns))


def dynamic_columns(profile, rng, *, output_v=None, extra_ug=0.0, noise_ug=5.0):
    """A unit of 14 µV/°C on a temperature profile, with `extra_ug` (n,) of departures from the line."""
    n = len(profile["t_s"])
    line_v = 3.2e-4 + 1.4e-5 * profile["T_C"] if output_v is None else output_v
    columns = {key: value.tolist() for key, value in profile.items()}
    columns["T_C"] = (profile["T_C"] + 0.005 * rng.standard_normal(n)).tolist()
    columns["U_V"] = (line_v + UG * (extra_ug + noise_ug * rng.standard_normal(n))).tolist()
    return columns


def step_ug(profile, cycle, leg, at_c, size_ug):
    """A step in a leg that lasts to the end of the record, and the true time of it."""
    of_leg = (profile["cycle"] == cycle) & (profile["leg"] == leg)
    passed = profile["T_C"] >= at_c if leg == "up" else profile["T_C"] <= at_c
    return np.where(profile["t_s"] >= profile["t_s"][of_leg & passed][0], size_ug, 0.0)


LIMITS = {"K1_V_per_g": K1, "jump_threshold_ug": 60, "jump_window": 8, "resid_limit_ug": 300, "repeat_limit_ug": 150}


@pytest.mark.parametrize("interval_s", [5.0, 10.0, 20.0])
def test_good_unit_passes(tmp_path, rng, interval_s):
    profile = ramps(interval_s)
    loop_ug = 1e6 * play_g(profile["T_C"], THRESHOLDS_C, 60e-6)
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=loop_ug, noise_ug=3.0), **LIMITS)
    truth = np.stack([loop_ug[profile["leg"] == leg] for leg in ("up", "down")]).reshape(2, 2, -1)
    assert result["verdict"] == "pass"
    assert result["jumps"] == []
    assert result["flags"] == []
    assert result["B1_V_per_C"] == pytest.approx(1.4e-5, rel=0.06)  # the loop leans against the ramp
    # A falling leg in reverse stands at the temperatures of the rising one. Noise adds to every maximum.
    widest_ug = np.max(np.abs(truth[0, :, 1:] - truth[1, :, :0:-1]))
    assert result["hysteresis_max_ug"] == pytest.approx(widest_ug, abs=12)
    change_ug = np.max(np.abs(truth[:, 1] - truth[:, 0]))
    assert result["repeatability_max_ug"] == pytest.approx(change_ug, abs=12)


@pytest.mark.parametrize(
    ("exchanged", "note"),
    [([(1, "up"), (1, "down"), (2, "up"), (2, "down")], "leg: up of cycle 1 falls, down of cycle 1 rises, up of "),
     ([(2, "down")], "leg: down of cycle 2 rises, and is left out; are up and down exchanged?")],
    ids=["all", "one"],
)  # fmt: skip
def test_legs_that_go_against_their_names_are_named(tmp_path, rng, exchanged, note):
    columns = dynamic_columns(ramps(10.0), rng)
    for row, leg in enumerate(zip(columns["cycle"], columns["leg"], strict=True)):
        if leg in exchanged:
            columns["T_C"][row] = 40.0 - columns["T_C"][row]
    result = reduced(tmp_path, columns, **LIMITS)
    assert (result["verdict"], "legs_exchanged" in result["flags"]) == ("invalid", True)
    assert [each for each in result["notes"] if each.startswith(note)], result["notes"]


def test_figures_are_those_of_independent_arithmetic(tmp_path, rng):
    columns = dynamic_columns(ramps(5.0), rng)
    result = reduced(tmp_path, columns, **LIMITS)
    temperature_c, output_v = np.array(columns["T_C"]), np.array(columns["U_V"])
    slope, offset = np.polyfit(temperature_c, output_v, 1)
    residual_ug = (output_v - offset - slope * temperature_c) / UG
    assert (result["B0_V"], result["B1_V_per_C"]) == pytest.approx((offset, slope), rel=1e-9)
    assert result["max_resid_ug"] == pytest.approx(np.max(np.abs(residual_ug)), rel=1e-6)
    assert result["rms_resid_ug"] == pytest.approx(np.sqrt(np.mean(residual_ug**2)), rel=1e-6)
    bins_ug = {}
    for cycle in (1, 2):
        for leg in ("up", "down"):
            of_leg = (np.array(columns["cycle"]) == cycle) & (np.array(columns["leg"]) == leg)
            for centre_c in range(-39, 80):
                near = of_leg & (np.abs(temperature_c - centre_c) <= 0.5)
                offset_c = temperature_c[near] - centre_c
                if offset_c.min() < 0 < offset_c.max():
                    bins_ug[cycle, leg, centre_c] = np.polyfit(offset_c, residual_ug[near], 1)[1]
    loops = [abs(v - bins_ug[c, "down", t]) for (c, leg, t), v in bins_ug.items() if (c, "down", t) in bins_ug]
    changes = [abs(v - bins_ug[1, leg, t]) for (c, leg, t), v in bins_ug.items() if (1, leg, t) in bins_ug]
    assert result["hysteresis_max_ug"] == pytest.approx(max(loops), rel=1e-6)
    assert result["repeatability_max_ug"] == pytest.approx(max(changes), rel=1e-6)


@pytest.mark.parametrize("interval_s", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("noise_ug", [2.0, 10.0])
def test_jumping_unit_fails_and_the_jumps_are_reported(tmp_path, rng, interval_s, noise_ug):
    profile = ramps(interval_s)
    truth = [(1, "up", 40.0, 177.0), (1, "down", 55.0, -120.0), (2, "up", 20.0, -200.0), (2, "up", 60.0, 150.0)]
    extra_ug = sum(step_ug(profile, *jump) for jump in truth) + 1e6 * play_g(profile["T_C"], THRESHOLDS_C, 60e-6)
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=extra_ug, noise_ug=noise_ug), **LIMITS)
    assert result["verdict"] == "fail"
    assert [(jump["cycle"], jump["leg"]) for jump in result["jumps"]] == [(c, leg) for c, leg, _, _ in truth]
    for jump, (_, _, at_c, size_ug) in zip(result["jumps"], truth, strict=True):
        assert jump["T_C"] == pytest.approx(at_c, abs=2.1 * interval_s * 0.05)
        assert jump["size_ug"] == pytest.approx(size_ug, abs=4 * noise_ug)


def test_limits_decide(tmp_path, rng):
    profile = ramps(10.0)
    drift_ug = np.where(profile["cycle"] == 2, 80.0, 0.0)  # between the cycles, where no leg sees a jump
    columns = dynamic_columns(profile, rng, extra_ug=drift_ug, noise_ug=1.0)
    limits = {"K1_V_per_g": K1, "resid_limit_ug": 60, "repeat_limit_ug": 100}
    good = reduced(tmp_path, columns, **limits)
    assert (good["verdict"], good["jumps"]) == ("pass", [])
    assert good["repeatability_max_ug"] == pytest.approx(80, abs=5)
    assert good["max_resid_ug"] == pytest.approx(40, abs=6)
    assert reduced(tmp_path, columns, **limits | {"repeat_limit_ug": 70})["verdict"] == "fail"
    assert reduced(tmp_path, columns, **limits | {"resid_limit_ug": 30})["verdict"] == "fail"
    assert reduced(tmp_path, columns, K1_V_per_g=K1)["verdict"] == "pass"


@pytest.mark.parametrize("interval_s", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("tau_s", [120.0, 240.0])
def test_pure_lag_is_told_from_hysteresis(tmp_path, rng, interval_s, tau_s):
    profile = ramps(interval_s)
    behind_c = lagging_c(profile["t_s"], profile["T_C"], tau_s)
    result = reduced(tmp_path, dynamic_columns(profile, rng, output_v=1.4e-5 * behind_c, noise_ug=2.0), **LIMITS)
    loop_ug = 2 * 1.4e-5 * 0.05 * tau_s / UG  # 2 B1 s tau of equations 6.3, once it is fully open
    assert result["flags"] == []
    assert "lag" in result["notes"][0]
    assert result["jumps"] == []
    assert result["hysteresis_max_ug"] == pytest.approx(loop_ug, rel=0.07)
    # While the output turns, for some tau behind each turn, it is not -B1 tau dT/dt: the coefficient comes out low.
    model = result["lag_model"]
    assert -model["Bd_V_s_per_C"] / model["B1_V_per_C"] == pytest.approx(tau_s, rel=0.12)


def test_lag_in_step_with_the_rate_is_modelled_exactly(tmp_path, rng):
    profile = ramps(10.0)
    rate_c_per_s = np.where(profile["leg"] == "up", 0.05, -0.05)
    output_v = 3.2e-4 + 1.4e-5 * (profile["T_C"] - 240 * rate_c_per_s)
    result = reduced(tmp_path, dynamic_columns(profile, rng, output_v=output_v, noise_ug=2.0), **LIMITS)
    model = result["lag_model"]
    assert model["Bd_V_s_per_C"] == pytest.approx(-1.4e-5 * 240, rel=0.005)
    assert model["B0_V"] == pytest.approx(3.2e-4, abs=1e-6)
    assert model["max_resid_ug"] < 12
    assert result["max_resid_ug"] > 150
    assert result["flags"] == []
    assert "lag" in result["notes"][0]


@pytest.mark.parametrize("interval_s", [5.0, 20.0, 60.0])
def test_smooth_curvature_is_no_jump(tmp_path, rng, interval_s):
    profile = ramps(interval_s)
    warm_c = profile["T_C"] - 20
    curve_ug = 0.05 * warm_c**2 + 4e-4 * warm_c**3 - 1e-5 * warm_c**4
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=curve_ug, noise_ug=5.0), **LIMITS)
    assert result["jumps"] == []
    assert result["flags"] == []
    assert result["hysteresis_max_ug"] < 35
    line_ug = np.polyval(np.polyfit(profile["T_C"], curve_ug, 1), profile["T_C"])
    assert result["max_resid_ug"] == pytest.approx(np.max(np.abs(curve_ug - line_ug)), abs=25)


def test_order_duplicates_and_blanks_change_nothing(tmp_path, rng):
    profile = ramps(10.0)
    extra_ug = step_ug(profile, 2, "down", 33.3, -140) + 1e6 * play_g(profile["T_C"], THRESHOLDS_C, 60e-6)
    columns = dynamic_columns(profile, rng, extra_ug=extra_ug)
    columns["U_V"][100], columns["T_C"][333] = None, 850.0
    expected = reduced(tmp_path, columns, **LIMITS)
    found = reduced(tmp_path, shuffled(columns, rng), **LIMITS)
    assert found.pop("jumps") == [pytest.approx(jump) for jump in expected.pop("jumps")] != []
    assert found.pop("lag_model") == pytest.approx(expected.pop("lag_model"))
    assert found.pop("rejected") != expected.pop("rejected")
    assert found == {key: pytest.approx(value) for key, value in expected.items()}


def test_legs_with_their_own_clocks(tmp_path, rng):
    profile = ramps(10.0)
    columns = dynamic_columns(profile, rng, extra_ug=step_ug(profile, 1, "down", 30.0, 150.0))
    expected = reduced(tmp_path, columns, **LIMITS)
    samples = len(columns["t_s"]) // 4
    columns["t_s"] = (10.0 * (np.arange(4 * samples) % samples)).tolist()
    assert reduced(tmp_path, columns, **LIMITS) == expected | {
        "jumps": [pytest.approx(jump) for jump in expected["jumps"]],
        "lag_model": pytest.approx(expected["lag_model"]),
    }


def test_leg_in_two_pieces_is_not_looked_across(tmp_path, rng):
    # 20 up to 80, down to -40, up to 20 °C: the two rising pieces are one leg of the cycle.
    temperature_c = np.concatenate([np.arange(20, 80, 0.5), np.arange(80, -40, -0.5), np.arange(-40, 20, 0.5)])
    profile = {
        "cycle": np.ones(480, dtype=int),
        "leg": np.repeat(["up", "down", "up"], [120, 240, 120]),
        "t_s": 10.0 * np.arange(480),
        "T_C": temperature_c,
    }
    extra_ug = 0.05 * (temperature_c - 20) ** 2
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=extra_ug, noise_ug=2.0), **LIMITS)
    assert result["jumps"] == []
    assert result["rejected"]["thermometer"] == 0
    assert result["hysteresis_max_ug"] < 12
    assert result["repeatability_max_ug"] is None


def test_change_across_a_hole_in_the_record_is_no_jump(tmp_path, rng):
    # The output goes from one level to another while nothing was recorded for more than six minutes.
    profile = ramps(10.0)
    columns = dynamic_columns(profile, rng, extra_ug=np.where(profile["T_C"] > 35, 100.0, -100.0), noise_ug=2.0)
    for row in np.flatnonzero(np.abs(profile["T_C"] - 35) < 10):
        columns["U_V"][row] = None
    result = reduced(tmp_path, columns, **LIMITS)
    assert result["jumps"] == []
    assert result["hysteresis_max_ug"] < 12


def test_repeatability_is_against_the_first_cycle(tmp_path, rng):
    profile = ramps(10.0, cycles=3)
    extra_ug = np.select([profile["cycle"] == 2, profile["cycle"] == 3], [60.0, -30.0], 0.0)
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=extra_ug, noise_ug=1.0), **LIMITS)
    assert result["repeatability_max_ug"] == pytest.approx(60, abs=4)


def test_the_two_branches_of_a_turn_round_are_no_change_between_cycles(tmp_path, rng):
    # The unit is 4 min behind the air: every leg but the first begins on the branch of the one before it.
    profile = ramps(10.0)
    profile["T_C"] = lagging_c(profile["t_s"], profile["T_C"], 240.0)
    branch_ug = np.where(np.gradient(profile["T_C"]) > 0, 40.0, -40.0) + 10.0 * profile["cycle"]
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=branch_ug, noise_ug=1.0), **LIMITS)
    assert result["repeatability_max_ug"] == pytest.approx(10, abs=6)
    assert result["hysteresis_max_ug"] == pytest.approx(80, abs=6)
    assert result["rejected"]["turn"] > 100


def test_coarse_record_is_reduced_too(tmp_path, rng):
    # 3 °C from sample to sample, 30 samples a leg; a second cycle of which one sample is left.
    profile = {key: value[:61] for key, value in ramps(60.0, low_c=-20, high_c=70).items()}
    loop_ug = np.where(profile["leg"] == "up", -40.0, 40.0)
    result = reduced(tmp_path, dynamic_columns(profile, rng, extra_ug=loop_ug, noise_ug=1.0), **LIMITS)
    assert result["hysteresis_max_ug"] == pytest.approx(80, abs=4)
    assert result["repeatability_max_ug"] is None
    assert result["lag_model"]["max_resid_ug"] < 5
    assert result["jumps"] == []


def test_leg_that_lost_most_of_its_samples_makes_the_test_invalid(tmp_path, rng):
    columns = dynamic_columns(ramps(10.0), rng)
    columns["U_V"][10:160] = [None] * 150
    result = reduced(tmp_path, columns, **LIMITS)
    assert (result["verdict"], result["flags"]) == ("invalid", ["invalid"])


def test_one_leg_has_no_loop_and_no_lag(tmp_path, rng):
    profile = {key: value[:240] for key, value in ramps(10.0).items()}
    columns = dynamic_columns(profile, rng)
    columns["T_C"] = profile["T_C"].tolist()
    result = reduced(tmp_path, columns, **LIMITS)
    assert (result["hysteresis_max_ug"], result["repeatability_max_ug"], result["lag_model"]) == (None, None, None)
    assert result["flags"] == ["ill_conditioned"]
    assert result["verdict"] == "incomplete"
