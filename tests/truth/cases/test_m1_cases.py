"""Cases of M1, made from a known accelerometer on an indexing table, reduced and held against the truth."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from bench.errors import InputError
from bench.methods.indexing.reduction.calibrate import CalibrationSettings, calibrate
from bench.methods.indexing.reduction.sweep import SweepRecord, by_travel
from bench.metrology.propagation import Measured
from bench.offline.case import reduce_case
from tests.support.m1_cases import Unit, clock, sweep, write_case

ALL_TERMS = ["c0", "c1", "c2", "c3", "cxz", "delta"]
CURVED = Unit(c2=2e-5, c3=4e-5, cxz=6e-6)
NOISE_V = 2e-6


@pytest.fixture
def rng():
    return np.random.default_rng(20_250_311)


def reduced(folder, settings=None, **records):
    result = reduce_case(write_case(folder, settings or {}, **records))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    return result


def test_a_perfect_bench_finds_the_unit(tmp_path, rng):
    unit = Unit(cxz=2e-5)
    result = reduced(tmp_path, sweep=sweep(unit, rng))
    found = result["combined"]
    # Figures worked by hand for this combination.
    assert found["b_V"] == pytest.approx(unit.c0, abs=0.03e-6)
    assert found["G_V_per_g"] == pytest.approx(unit.c1, rel=0.2e-6)  # cos δ is 0.18 ppm below 1
    assert found["delta_rad"] == pytest.approx(unit.delta_rad, abs=1e-9)
    assert found["cxz_V_per_g2"] == pytest.approx(unit.cxz, rel=1e-5)
    assert found["dG_V_per_g"] / 2 == pytest.approx(unit.cxz * 0.990, rel=1e-4)  # too low by k̄
    assert found["db_V"] == pytest.approx(result["ends"]["up"]["b_V"] - result["ends"]["down"]["b_V"], rel=1e-12)
    model = result["model"]
    assert model["params"] == pytest.approx({"c0": 8e-4, "c1": 1.13, "cxz": 2e-5, "delta": 6e-4}, rel=1e-9)
    assert model["cond"] == pytest.approx(1.0, abs=0.05)
    assert (model["rank"], result["flags"], result["notes"]) == (4, [], [])
    assert 3 <= model["iterations"] <= 6
    assert model["rms_V"] < 1e-15
    assert model["ieee"] == {
        "K1_V_per_g": pytest.approx(1.13), "K0_g": pytest.approx(8e-4 / 1.13), "K2_g_per_g2": None,
        "K3_g_per_g3": None, "Kxz_g_per_g2": pytest.approx(2e-5 / 1.13), "delta_rad": pytest.approx(6e-4),
    }  # fmt: skip


def test_result_has_the_keys_of_the_method(tmp_path, rng):
    unit = Unit()
    result = reduced(tmp_path, sweep=sweep(unit, rng, noise_v=NOISE_V), clock=clock(unit, rng, (1e-4, 0)))
    assert list(result) == ["method", "sub", "ends", "combined", "model", "rejected", "flags", "notes"]
    assert list(result["ends"]) == ["up", "down"]
    assert list(result["ends"]["up"]) == ["b_V", "G_V_per_g", "u_b", "u_G", "linearity", "hysteresis_max_V", "n"]
    assert set(result["combined"]) == {
        "G_V_per_g", "b_V", "dG_V_per_g", "db_V", "delta_rad", "cxz_V_per_g2", "decision", "b3_V", "b4_V", "b5_V",
        "b_total_V", "b_corrected_V", "surface_tilt_rad", "u",
    }  # fmt: skip
    assert list(result["model"]) == ["params", "u", "covariance", "cond", "rank", "rms_V", "iterations", "ieee"]
    assert list(result["rejected"]) == ["unstable", "saturated", "outlier"]


def test_the_line_of_an_end_is_that_of_independent_arithmetic(tmp_path, rng):
    rows = sweep(CURVED, rng, noise_v=NOISE_V, loop_v=1e-5)
    result = reduced(tmp_path, sweep=rows)
    for end in ("up", "down"):
        sine = np.sin(np.radians([row["theta_deg"] for row in rows if row["end"] == end]))
        output_v = np.array([row["V_mean"] for row in rows if row["end"] == end])
        (scale, bias), covariance = np.polyfit(sine, output_v, 1, cov=True)
        residual = output_v - bias - scale * sine
        found = result["ends"][end]
        assert found["G_V_per_g"] == pytest.approx(scale, rel=1e-12)
        assert found["b_V"] == pytest.approx(bias, rel=1e-9)
        assert [found["u_G"], found["u_b"]] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
        assert found["linearity"] == pytest.approx(np.max(np.abs(residual)) / (scale * np.ptp(sine)), rel=1e-9)
        assert found["hysteresis_max_V"] == pytest.approx(np.max(np.abs(output_v[:21] - output_v[:20:-1])), rel=1e-6)
        assert found["n"] == 42


def test_nonlinear_terms_over_a_large_range(tmp_path, rng):
    result = reduced(tmp_path, {"terms": ALL_TERMS}, sweep=sweep(CURVED, rng, largest_deg=40, noise_v=NOISE_V))
    model = result["model"]
    for term in ALL_TERMS:
        truth = getattr(CURVED, {"delta": "delta_rad"}.get(term, term))
        assert abs(model["params"][term] - truth) < 3.5 * model["u"][term]
    assert model["u"]["c2"] < 5e-6
    assert model["ieee"]["K2_g_per_g2"] == pytest.approx(model["params"]["c2"] / model["params"]["c1"])
    covariance = np.array(model["covariance"])
    assert np.sqrt(np.diag(covariance)) == pytest.approx(list(model["u"].values()))
    assert result["flags"] == []


def record(rows):
    column = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    quiet = SweepRecord(
        end=column["end"], direction=column["pass"], sequence=column["seq"].astype(float),
        angle_deg=column["theta_deg"], output_v=column["V_mean"], stable=column["stable"] == 1,
        temperature_c=np.full(len(rows), np.nan), side=np.full(len(rows), ""), stand=np.zeros(len(rows), np.int_),
    )  # fmt: skip
    return by_travel(quiet)


def with_noise(quiet, rng):
    return replace(quiet, output_v=quiet.output_v + NOISE_V * rng.standard_normal(len(quiet)))


def rms(relative):
    return np.sqrt(np.mean(np.square(relative), axis=0))


@pytest.mark.parametrize("drift_v", [0.0, 1.5e-6])
def test_errors_are_as_large_as_stated(drift_v):
    unit, seat_rad, level_rad, u_level_rad = Unit(cxz=2e-6), 1e-4, -5e-5, 2e-6
    rng = np.random.default_rng(0)
    quiet = record(sweep(unit, rng, largest_deg=4, drift_v=drift_v, tilt_rad=seat_rad + level_rad))
    turned = clock(unit, rng, (seat_rad + level_rad, 3e-5))
    psi_rad, seat_v = np.radians([row["psi_deg"] for row in turned]), np.array([row["V"] for row in turned])
    tilted_v = unit.c0 + unit.c1 * (seat_rad + level_rad)
    truth = [unit.c1, tilted_v, unit.delta_rad, unit.cxz, unit.c0]
    true_terms = [tilted_v, unit.c1, unit.cxz, unit.delta_rad, drift_v]
    relative, relative_terms = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        level = Measured(level_rad + u_level_rad * rng.standard_normal(), u_level_rad)
        noisy = psi_rad, seat_v + NOISE_V * rng.standard_normal(4)
        found = calibrate(with_noise(quiet, rng), CalibrationSettings(installation_rad=level), noisy)
        both, model = found.both, found.model.fit
        measured = (
            both.scale_v_per_g, both.bias_v, both.misalignment_rad, both.coupling_v_per_g2, both.bias_corrected_v,
        )  # fmt: skip
        relative.append([(m.value - true) / m.u for m, true in zip(measured, truth, strict=True)])
        relative_terms.append((model.parameters - true_terms[: len(model.parameters)]) / model.u)
    assert rms(relative) == pytest.approx(np.ones(5), abs=0.15)
    assert rms(relative_terms) == pytest.approx(np.ones(5 if drift_v else 4), abs=0.15)


def test_mounting_terms_are_signed_and_taken_away(tmp_path, rng):
    unit = Unit()
    mount = {"angle3_rad": 2e-4, "angle4_rad": -5e-5}
    whole_rad = 2e-4 - 5e-5 + 3e-4  # which the clocking sees, as it is done on the same seat
    rows = sweep(unit, rng, largest_deg=2, tilt_rad=whole_rad)
    found = reduced(tmp_path, {"mount": mount}, sweep=rows, clock=clock(unit, rng, (whole_rad, -4e-4)))["combined"]
    scale = found["G_V_per_g"]
    assert found["b3_V"] == pytest.approx(scale * np.sin(2e-4))
    assert found["b4_V"] == pytest.approx(-scale * np.sin(5e-5))
    assert found["b5_V"] == pytest.approx(scale * 3e-4, rel=1e-6)
    assert found["surface_tilt_rad"] == pytest.approx(np.hypot(whole_rad, 4e-4), rel=1e-6)
    added = found["b3_V"] + found["b4_V"] + found["b5_V"]
    assert found["b_total_V"] == pytest.approx(found["b_V"] + added)
    assert found["b_corrected_V"] == pytest.approx(found["b_V"] - added)
    assert found["b_corrected_V"] == pytest.approx(unit.c0, abs=0.15e-6)  # 0.02 % of the tilt
    assert found["delta_rad"] == pytest.approx(unit.delta_rad, abs=2e-9)


def test_a_seat_turned_by_half_a_turn_only(tmp_path, rng):
    unit = Unit()
    turned = clock(unit, rng, (3e-4, -4e-4), psi_deg=(0, 180))
    found = reduced(tmp_path, sweep=sweep(unit, rng), clock=turned)["combined"]
    assert found["b5_V"] == pytest.approx((turned[0]["V"] - turned[1]["V"]) / 2)
    assert found["surface_tilt_rad"] is None
    assert found["b3_V"] is None
    assert found["b_total_V"] == pytest.approx(found["b_V"] + found["b5_V"])


def test_a_seat_that_was_not_turned_enough(tmp_path, rng):
    unit = Unit()
    turned = [*clock(unit, rng, (3e-4, 0), psi_deg=(0, 90)), {"psi_deg": 180, "V": None}]
    result = reduced(tmp_path, sweep=sweep(unit, rng), clock=turned)
    assert result["combined"]["b5_V"] is None
    assert result["flags"] == ["ill_conditioned"]
    assert result["notes"] == [
        "clock: mean, cos ψ and sin ψ are not determined by these readings (rank 2 of 3, condition number inf)"
    ]


def test_order_and_duplicates_change_nothing(tmp_path, rng):
    rows = sweep(CURVED, rng, noise_v=NOISE_V)
    expected = reduced(tmp_path, sweep=rows)
    blank = dict.fromkeys(rows[0])
    others = [*rows, *rows[::5], blank, blank]
    rng.shuffle(others)
    found = reduced(tmp_path, sweep=others)
    assert found.pop("notes") == [
        "rows left out because something is missing in them: 2", "rows left out because they are there twice: 17",
    ]  # fmt: skip
    assert expected.pop("notes") == []
    assert json.dumps(found) == json.dumps(expected)


def test_blank_cells_leave_out_their_rows(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    for row, column in zip(range(3, 80, 15), ("V_mean", "theta_deg", "seq", "pass", "end", "V_std"), strict=True):
        rows[row][column] = None
    result = reduced(tmp_path, sweep=rows)
    assert result["ends"]["up"]["n"] + result["ends"]["down"]["n"] == 84 - 5  # V_std is not needed
    assert result["combined"]["b_V"] == pytest.approx(8e-4, abs=3e-6)
    assert result["notes"] == ["rows left out because something is missing in them: 5"]


def test_unstable_and_saturated_dwells_are_not_fitted(tmp_path, rng):
    limit_v = 1.13 * np.sin(np.radians(7.5))
    rows = sweep(Unit(), rng)
    for row in rows:
        row["V_mean"] = float(np.clip(row["V_mean"], -limit_v, limit_v))
    for row in (11, 12, 50):  # near level
        rows[row] |= {"stable": 0, "V_mean": 0.3}
    result = reduced(tmp_path, {"output_limit_V": limit_v}, sweep=rows)
    assert result["rejected"] == {"unstable": 3, "saturated": 2 * 2 * 6, "outlier": 0}
    assert result["combined"]["G_V_per_g"] == pytest.approx(1.13, rel=1e-6)
    assert result["model"]["params"]["delta"] == pytest.approx(6e-4, rel=1e-9)


def test_outliers_are_dropped(tmp_path, rng):
    rows = sweep(CURVED, rng, noise_v=NOISE_V)
    expected = reduced(tmp_path, sweep=[row for i, row in enumerate(rows) if i not in (0, 30, 60)])
    for row, error_v in ((0, 1e-3), (30, -2e-4), (60, 0.4)):
        rows[row]["V_mean"] += error_v
    result = reduced(tmp_path, sweep=rows)
    assert result["rejected"]["outlier"] == 3
    assert result | {"rejected": None} == expected | {"rejected": None}
    assert reduced(tmp_path, {"outlier_k": 1e6}, sweep=rows)["rejected"]["outlier"] == 0


def test_more_than_a_tenth_of_outliers_is_invalid(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    for row in (1, 9, 17, 25, 33):
        rows[row]["V_mean"] += 0.02
    result = reduced(tmp_path, sweep=rows)
    assert result["flags"] == ["invalid"]
    assert result["combined"]["decision"] == "invalid"
    assert result["combined"]["G_V_per_g"] is None
    assert result["rejected"]["outlier"] == 5
    assert result["notes"] == ["end up: 5 of 42 dwells are outliers"]


def test_hysteresis_is_measured_and_no_outlier():
    quiet = record(sweep(Unit(cxz=2e-6), np.random.default_rng(0), loop_v=4e-5, largest_deg=5))
    for seed in range(40):
        found = calibrate(with_noise(quiet, np.random.default_rng(seed)), CalibrationSettings())
        assert found.ends["up"].fit.hysteresis_v == pytest.approx(4e-5, abs=1e-5)
        assert (found.excluded["outlier"], found.flags, found.notes) == (0, (), ())


def test_equal_histories_are_not_called_hysteresis(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    from_below = [{**row, "approach": "from_below"} for row in rows]
    result = reduced(tmp_path, sweep=from_below)
    assert result["ends"]["up"]["hysteresis_max_V"] is None
    assert result["flags"] == ["hysteresis:equal_histories"]
    assert reduced(tmp_path, sweep=rows)["flags"] == [], "without that column the order tells the sides"


def test_the_sides_of_a_column_count_more_than_the_order(tmp_path, rng):
    rows = sweep(Unit(), rng, loop_v=4e-5)
    expected = reduced(tmp_path, sweep=rows)["ends"]["up"]["hysteresis_max_V"]
    named = [{**row, "approach": "from_below" if row["pass"] == "fwd" else "from_above"} for row in rows]
    by_angle = sorted(named, key=lambda row: (row["end"], row["theta_deg"], row["pass"]))
    in_another_order = [{**row, "seq": number} for number, row in enumerate(by_angle)]
    assert reduced(tmp_path, sweep=in_another_order)["ends"]["up"]["hysteresis_max_V"] == pytest.approx(expected)
    assert expected == pytest.approx(4e-5, rel=0.02)


@pytest.mark.parametrize("end", ["up", "down"])
def test_one_end_alone(tmp_path, rng, end):
    result = reduced(tmp_path, {"terms": ["c0", "c1"]}, sweep=sweep(Unit(), rng, ends=[end], noise_v=NOISE_V))
    missing = {"up": "down", "down": "up"}[end]
    assert result["flags"] == [f"end_{missing}_missing"]
    assert result["combined"] is None
    assert result["ends"][missing] is None
    assert result["ends"][end]["G_V_per_g"] == pytest.approx(1.13, abs=2e-5)
    assert result["model"]["params"]["c1"] == pytest.approx(1.13, abs=2e-5)


def test_an_end_without_a_usable_dwell_is_missing(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    for row in rows:
        row["stable"] = 0 if row["end"] == "down" else 1
    result = reduced(tmp_path, {"terms": ["c0", "c1"]}, sweep=rows)
    assert result["flags"] == ["end_down_missing"]
    assert result["combined"] is None
    assert result["ends"]["down"] is None
    assert result["ends"]["up"]["G_V_per_g"] == pytest.approx(1.13, abs=2e-5)
    assert result["notes"] == ["end down: none of its dwells can be used"]


@pytest.mark.parametrize("sub", ["", "static", "sweep", None])
def test_a_method_of_one_reduction_takes_any_sub(tmp_path, rng, sub):
    path = write_case(tmp_path, {}, sweep=sweep(Unit(), rng))
    expected = reduce_case(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"sub": sub}))
    assert reduce_case(path) == expected | {"sub": sub or ""}


def test_what_one_end_cannot_tell_apart_is_named(tmp_path, rng):
    rows = sweep(Unit(), rng, ends=["up"], largest_deg=5, noise_v=NOISE_V)
    result = reduced(tmp_path, {"terms": ["c0", "c1", "delta"]}, sweep=rows)
    assert result["flags"] == ["end_down_missing", "ill_conditioned"]
    assert result["model"]["cond"] == pytest.approx(1.6e3, rel=0.01)
    assert result["model"]["rank"] == 3
    assert result["model"]["u"]["delta"] > 1e-4  # the value stands, and says what it is worth
    assert result["notes"] == [
        "model: c0 and delta are not determined by these readings (rank 3 of 3, condition number 1.61e+03)"
    ]
    allowed = reduced(tmp_path, {"terms": ["c0", "c1", "delta"], "cond_limit": 1e4}, sweep=rows)
    assert allowed["flags"] == ["end_down_missing"]


def test_terms_without_readings_for_them(tmp_path, rng):
    rows = sweep(Unit(), rng, angles_deg=[-5.0, 0.0, 5.0])
    result = reduced(tmp_path, {"terms": ALL_TERMS}, sweep=rows)
    model = result["model"]
    assert result["flags"] == ["ill_conditioned"]
    assert model["params"] == dict.fromkeys(ALL_TERMS)
    assert (model["rank"], model["cond"], model["rms_V"], model["covariance"]) == (5, None, None, None)
    assert "c1" in result["notes"][0]
    assert "c3" in result["notes"][0]
    assert result["combined"]["G_V_per_g"] == pytest.approx(1.13, rel=1e-6)


@pytest.mark.parametrize(
    ("angles_deg", "why"),
    [
        ([5.0, 5.0, 5.0, 5.0], "fewer than 3 different angles are left"),
        ([-5.0, 5.0], "fewer than 3 different angles are left"),
        ([5.0, 5.001, 5.002], "its angles do not determine a line"),
    ],
)
def test_too_few_angles(tmp_path, rng, angles_deg, why):
    rows = sweep(Unit(), rng, ends=["up"]) + sweep(Unit(), rng, ends=["down"], angles_deg=angles_deg)
    result = reduced(tmp_path, sweep=rows)
    assert "invalid" in result["flags"]
    assert result["combined"]["decision"] == "invalid"
    assert result["ends"]["down"]["G_V_per_g"] is None
    assert result["ends"]["up"]["G_V_per_g"] == pytest.approx(1.13, rel=1e-5)
    assert f"end down: {why}" in result["notes"]


def test_a_sensor_that_saturates_at_every_angle_but_zero(tmp_path, rng):
    rows = sweep(Unit(), rng, largest_deg=30, angles=7)
    for row in rows:
        row["theta_deg"] += 1e-5 * rng.standard_normal()  # as the table stands
        row["V_mean"] = float(np.clip(row["V_mean"], -0.05, 0.05))
    result = reduced(tmp_path, {"output_limit_V": 0.05}, sweep=rows)
    assert "invalid" in result["flags"]
    assert result["rejected"]["saturated"] == 24
    assert result["combined"]["decision"] == "invalid"


def test_a_dead_sensor(tmp_path, rng):
    rows = [row | {"V_mean": 0.1} for row in sweep(Unit(), rng)]
    result = reduced(tmp_path, sweep=rows)
    assert "invalid" in result["flags"]
    assert "end up: its output does not follow the angle" in result["notes"]


def test_output_that_beats_with_the_sampling_is_told(tmp_path, rng):
    rows = sweep(Unit(cxz=2e-6), rng, noise_v=NOISE_V)
    assert reduced(tmp_path, sweep=rows)["notes"] == []
    for row in rows[:42]:
        row["V_mean"] += 1e-5 * np.cos(2 * np.pi * 7 * row["theta_deg"] / 21)
    result = reduced(tmp_path, sweep=rows)
    assert result["notes"] == [
        "end up: the residuals repeat themselves 7 times over the angles; see whether the output beats with the "
        "sampling, or resonates"
    ]
    assert result["flags"] == []


@pytest.mark.parametrize(("change_c", "marginal"), [(0.4, False), (0.7, True)])
def test_a_temperature_that_changes_during_a_sweep(tmp_path, rng, change_c, marginal):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    for i, row in enumerate(rows):
        row["T_C"] = 20 + (change_c * i / 41 if i < 42 else 0.0)
    rows[5]["T_C"] = None
    rows[6]["T_C"] = 850  # an open sensor
    result = reduced(tmp_path, {"G_tol_rel": 1e-3}, sweep=rows)
    assert result["flags"] == ["marginal"] * marginal
    assert result["combined"]["decision"] == ("marginal" if marginal else "accept")
    assert result["notes"] == ["end up: the temperature changed by 0.70 °C"] * marginal


def test_a_drifting_bias_is_fitted(tmp_path, rng):
    unit = Unit(cxz=2e-6)
    rows = sweep(unit, rng, largest_deg=5, noise_v=NOISE_V, drift_v=2e-6)
    result = reduced(tmp_path, sweep=rows)
    for end, note in zip(("up", "down"), result["notes"], strict=True):
        drift = re.fullmatch(rf"end {end}: the bias drifts by (\S+) V per dwell; b_V is the bias at the first.*", note)
        assert float(drift[1]) == pytest.approx(2e-6, abs=0.1e-6)
    assert result["model"]["params"]["seq"] == pytest.approx(2e-6, abs=0.1e-6)
    # The bias is that at the first dwell; without the term it would be 83 µV higher, and the misalignment 37 µrad off.
    assert result["combined"]["b_V"] == pytest.approx(unit.c0, abs=8e-6)
    assert result["combined"]["delta_rad"] == pytest.approx(unit.delta_rad, abs=8e-6)
    assert result["ends"]["up"]["hysteresis_max_V"] < 1.2e-5
    assert result["flags"] == []


def test_a_drift_where_one_end_has_no_way_back(tmp_path, rng):
    rows = [row for row in sweep(Unit(), rng, noise_v=NOISE_V, drift_v=2e-6) if row["seq"] < 63]
    result = reduced(tmp_path, sweep=rows)
    assert [note.partition(" drifts")[0] for note in result["notes"]] == ["end up: the bias"]
    assert result["ends"]["down"]["hysteresis_max_V"] is None
    assert result["model"]["params"]["seq"] == pytest.approx(2e-6, abs=0.2e-6)


def test_a_drift_where_the_other_end_has_no_line(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V, drift_v=2e-6)
    result = reduced(tmp_path, sweep=[row for row in rows if row["end"] == "up" or row["theta_deg"] == 5])
    assert result["flags"] == ["invalid"]
    assert result["ends"]["up"]["b_V"] == pytest.approx(8e-4 + 1.13 * 6e-4, abs=1e-5)


def test_two_readings_of_the_sine_at_each_angle(tmp_path, rng):
    rows = sweep(Unit(), rng, angles_deg=[-270, 0, 90, 180, 360, 450])
    result = reduced(tmp_path, {"terms": ["c0", "c1"]}, sweep=rows)
    assert result["combined"]["G_V_per_g"] == pytest.approx(1.13, rel=1e-6)


@pytest.mark.parametrize(
    ("settings", "decision"),
    [
        ({}, "repeat"),
        ({"G_tol_rel": 1e-4}, "accept"),
        ({"k_tol": 1e3}, "accept"),
        ({"repeats": 2}, "repeat"),
        ({"repeats": 3}, "marginal"),
        ({"repeats": 1, "max_repeats": 1}, "marginal"),
    ],
)
def test_scale_factors_of_both_ends_agree_or_not(tmp_path, rng, settings, decision):
    rows = sweep(Unit(cxz=3e-5), rng, largest_deg=5, noise_v=NOISE_V)
    result = reduced(tmp_path, settings, sweep=rows)
    assert result["combined"]["decision"] == decision
    assert result["flags"] == (["marginal"] if decision == "marginal" else [])
    assert result["combined"]["cxz_V_per_g2"] == pytest.approx(3e-5, abs=2e-5)


def test_ends_swept_over_different_angles(tmp_path, rng):
    unit = Unit(delta_rad=5e-3, cxz=4e-5)
    rows = sweep(unit, rng, ends=["up"]) + sweep(unit, rng, ends=["down"], angles_deg=np.linspace(-4, 5, 10))
    found = reduced(tmp_path, sweep=rows)["combined"]
    # The plain mean would be 17 µV off.
    assert found["b_V"] == pytest.approx(unit.c0, abs=0.5e-6)
    assert found["delta_rad"] == pytest.approx(5e-3, rel=1e-4)
    assert found["cxz_V_per_g2"] == pytest.approx(4e-5, rel=0.02)


def test_a_whole_turn_tells_nothing_about_misalignment(tmp_path, rng):
    rows = sweep(Unit(), rng, angles_deg=np.arange(-180, 180, 15))
    result = reduced(tmp_path, {"terms": ["c0", "c1"]}, sweep=rows)
    assert result["combined"]["delta_rad"] is None
    assert result["combined"]["cxz_V_per_g2"] is None
    assert result["combined"]["b_V"] == pytest.approx(8e-4, abs=1e-9)


@pytest.mark.parametrize("factor", [1e-6, -1.0, 1e3, 1e9])
def test_other_units_of_the_output_scale_the_result(tmp_path, rng, factor):
    rows = sweep(CURVED, rng, noise_v=NOISE_V)
    expected = reduced(tmp_path, sweep=rows)
    result = reduced(tmp_path, sweep=[row | {"V_mean": row["V_mean"] * factor} for row in rows])
    for key in ("G_V_per_g", "b_V", "cxz_V_per_g2"):
        assert result["combined"][key] == pytest.approx(expected["combined"][key] * factor, rel=1e-6)
    assert result["combined"]["delta_rad"] == pytest.approx(expected["combined"]["delta_rad"], rel=1e-6)
    assert result["model"]["params"]["delta"] == pytest.approx(expected["model"]["params"]["delta"], rel=1e-6)
    assert result["model"]["ieee"]["K0_g"] == pytest.approx(expected["model"]["ieee"]["K0_g"], rel=1e-6)
    assert [flag for flag in result["flags"] if not flag.startswith("implausible")] == expected["flags"]
    assert (len(result["flags"]) > 0) == (factor != -1.0)  # a sensor may read downwards, not µV for V


@pytest.mark.parametrize("factor", [np.pi / 180, 60.0, 3600.0])
def test_angles_in_another_unit_are_not_a_crash(tmp_path, rng, factor):
    rows = [row | {"theta_deg": row["theta_deg"] * factor} for row in sweep(Unit(), rng, noise_v=NOISE_V)]
    result = reduced(tmp_path, {"terms": ALL_TERMS}, sweep=rows)
    assert factor < 1 or result["ends"]["up"] is None or result["ends"]["up"]["linearity"] is None or (
        result["ends"]["up"]["linearity"] > 0.1
    )  # fmt: skip


@pytest.mark.parametrize("extreme", ["1e300", "-1e308", "1e-320", "inf", "nan"])
def test_one_extreme_value_is_left_out(tmp_path, rng, extreme):
    rows = sweep(Unit(), rng, noise_v=NOISE_V)
    rows[37]["V_mean"] = extreme
    result = reduced(tmp_path, sweep=rows)
    assert result["combined"]["b_V"] == pytest.approx(8e-4, abs=3e-6)
    assert result["ends"]["up"]["n"] == 41


@pytest.mark.parametrize("noise_v", [0.0, 1e-7, NOISE_V])
def test_where_the_table_turns_back_there_is_no_hysteresis_yet(tmp_path, rng, noise_v):
    rows = sweep(Unit(), rng, noise_v=noise_v)
    for row in rows:
        row["V_mean"] += 1e-4 * (row["pass"] == "rev" and row["theta_deg"] < 9.9)
    result = reduced(tmp_path, sweep=rows)
    assert result["rejected"]["outlier"] == 0
    assert result["ends"]["up"]["hysteresis_max_V"] == pytest.approx(1e-4, abs=8 * noise_v + 1e-12)
    rows[20]["V_mean"] += 2e-3  # at the turning point
    rows[33]["V_mean"] += 2e-3
    assert reduced(tmp_path, sweep=rows)["rejected"]["outlier"] == 2


def test_without_sequence_numbers_the_order_is_that_of_the_file(tmp_path, rng):
    rows = sweep(Unit(), rng, noise_v=NOISE_V, drift_v=2e-6)
    numbered = reduced(tmp_path, sweep=rows)
    blank = reduced(tmp_path, sweep=[row | {"seq": None} for row in rows])
    assert blank == numbered
    assert blank["model"]["params"]["seq"] == pytest.approx(2e-6, abs=0.1e-6)


@pytest.mark.parametrize("column", ["V_mean", "theta_deg", "seq"])
@pytest.mark.parametrize("factor", [1e300, 1e-300, 0.0])
def test_a_column_of_extreme_values_gives_no_nonsense(tmp_path, rng, column, factor):
    rows = [row | {column: row[column] * factor} for row in sweep(Unit(), rng, noise_v=NOISE_V)]
    result = reduced(tmp_path, sweep=rows)
    assert result["combined"]["decision"] in ("accept", "repeat", "invalid")


@pytest.mark.parametrize("rows", [[], [0], [0, 1], list(range(5))])
def test_few_rows(tmp_path, rng, rows):
    every = sweep(Unit(), rng)
    result = reduced(tmp_path, sweep=[every[i] for i in rows] or [dict.fromkeys(every[0])])
    assert "end_down_missing" in result["flags"]
    assert ("end_up_missing" in result["flags"]) == (not rows)
    assert ("invalid" in result["flags"]) == (0 < len(rows) < 3)
    assert result["combined"] is None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"terms": ["c0", "k1"]}, "case.json: settings.terms.1: is 'k1', expected 'c0', 'c1', 'c2', 'c3', 'cxz'"),
        ({"terms": []}, "case.json: settings.terms: "),
        ({"terms": ["c0", "c0"]}, "case.json: settings.terms: names a term twice"),
        ({"terms": "c0"}, "case.json: settings.terms: is 'c0', expected a list"),
        ({"G_tol_rel": -1}, "case.json: settings.G_tol_rel: is -1, expected at least 0"),
        ({"outlier_k": 0}, "case.json: settings.outlier_k: is 0, expected more than 0"),
        ({"output_limit_V": 0}, "case.json: settings.output_limit_V: is 0, expected more than 0"),
        ({"mount": {"angle3_rad": "flat"}}, "case.json: settings.mount.angle3_rad: is 'flat', expected a number"),
    ],
)
def test_bad_settings_are_refused(tmp_path, rng, settings, message):
    with pytest.raises(InputError) as caught:
        reduce_case(write_case(tmp_path, settings, sweep=sweep(Unit(), rng)))
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("end", "sideways", "sweep.csv: line 3, column end: 'sideways' is not up or down; correct it"),
        ("pass", "back", "sweep.csv: line 3, column pass: 'back' is not fwd or rev; correct it"),
        ("theta_deg", "5°", "sweep.csv: line 3, column theta_deg: '5°' is not a number; write the number alone, 5"),
        ("stable", "perhaps", "sweep.csv: line 3, column stable: 'perhaps' is not 1, 0, true or false; correct it"),
    ],
)
def test_bad_cells_are_refused(tmp_path, rng, column, value, message):
    rows = sweep(Unit(), rng)
    rows[1][column] = value
    with pytest.raises(InputError) as caught:
        reduce_case(write_case(tmp_path, {}, sweep=rows))
    assert str(caught.value).startswith(message)


def test_missing_records_and_columns_are_refused(tmp_path, rng):
    with pytest.raises(InputError, match="records: 'sweep' is missing; M1 needs it"):
        reduce_case(write_case(tmp_path, {}, clock=clock(Unit(), rng, (0, 0))))
    rows = [{key: value for key, value in row.items() if key != "V_mean"} for row in sweep(Unit(), rng)]
    with pytest.raises(InputError, match=r"sweep\.csv: line 1: there is no column 'V_mean'"):
        reduce_case(write_case(tmp_path, {}, sweep=rows))


def test_bench_reduce_writes_the_result(tmp_path, rng, bench_here):
    path = write_case(tmp_path, {"terms": ALL_TERMS}, sweep=sweep(CURVED, rng, largest_deg=30, noise_v=NOISE_V))
    done = bench_here("reduce", path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert result["method"] == "M1"
    assert result["combined"]["G_V_per_g"] == pytest.approx(1.13, abs=2e-5)
