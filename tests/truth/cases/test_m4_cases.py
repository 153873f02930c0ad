"""Static and tilt cases of M4, made from a known accelerometer (equations 8.4), reduced and held against the truth."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from bench.offline.case import reduce_case, reduced_case
from tests.support.m4_cases import DEFAULT_CYCLE_C, THRESHOLDS_C, play_g, shuffled, static_columns, write_case

LINEAR = {"bias_v": [2.4e-4, 1.1e-5], "scale_v_per_g": [1.13, -6.6e-5]}  # (3) and (4) of the seed
CURVED = {"bias_v": [2.4e-4, 1.1e-5, 3e-8, 4e-10, 2e-12], "scale_v_per_g": [1.13, -6.6e-5, 2e-8, -3e-10]}
K1 = 1.13


@pytest.fixture
def rng():
    return np.random.default_rng(20_240_607)


def reduced(tmp_path, sub, columns, **settings):
    return reduce_case(write_case(tmp_path, sub, settings, columns))


def test_static_linear_unit_without_noise_is_found_exactly(tmp_path, rng):
    columns, bias_v = static_columns(rng, **LINEAR)
    result = reduced(tmp_path, "static", columns, degree=4)
    assert result["flags"] == []
    assert [point["K0_V"] for point in result["points"]] == pytest.approx(bias_v, abs=1e-12)
    assert [point["K2_V_per_g2"] for point in result["points"]] == pytest.approx([2e-5] * 23, abs=1e-12)
    assert [point["delta_rad"] for point in result["points"]] == pytest.approx([8e-4] * 23, abs=1e-10)
    assert [point["T_set_C"] for point in result["points"]] == DEFAULT_CYCLE_C
    assert [point["dwell"] for point in result["points"]] == list(range(23))
    # The thermometer scatters by 5 mK, 2 mK in the mean of a dwell: 0.02 µV of bias.
    assert result["K0"]["linear"] == pytest.approx([2.4e-4, 1.1e-5], rel=1e-3)
    assert result["K1"]["linear"] == pytest.approx([1.13, -6.6e-5], rel=1e-3)
    assert result["K0"]["poly"][:2] == pytest.approx([2.4e-4, 1.1e-5], rel=3e-3)
    assert len(result["K0"]["poly"]) == len(result["K1"]["poly"]) == 5
    assert result["K0"]["max_resid_linear"] < 1e-7
    assert result["K0"]["hysteresis_max"] < 1.5e-7  # though rising and falling dwells stood up to 1 °C apart


def test_static_figures_are_those_of_independent_arithmetic(tmp_path, rng):
    columns, _ = static_columns(rng, **CURVED, noise_v=3e-6)
    result = reduced(tmp_path, "static", columns, degree=4)
    reading = np.array(columns["U_V"]).reshape(-1, 8)
    e0, e90, e180, e270 = ((reading[:, i] + reading[:, 7 - i]) / 2 for i in range(4))
    temperature_c = np.array(columns["T_meas_C"]).reshape(-1, 8).mean(axis=1)
    bias_v, scale = (e0 + e180) / 2, (e90 - e270) / 2
    assert [point["T_C"] for point in result["points"]] == pytest.approx(temperature_c, abs=1e-12)
    assert [point["K0_V"] for point in result["points"]] == pytest.approx(bias_v, abs=1e-15)
    assert [point["K1_V_per_g"] for point in result["points"]] == pytest.approx(scale, rel=1e-14)
    for key, value in (("K0", bias_v), ("K1", scale)):
        quartic = polynomial.Polynomial.fit(temperature_c, value, 4)
        line, covariance = np.polyfit(temperature_c, value, 1, cov=True)
        found = result[key]
        assert found["poly"] == pytest.approx(quartic.convert().coef, rel=1e-6)
        assert found["linear"] == pytest.approx(line[::-1], rel=1e-9)
        assert found["u_linear"] == pytest.approx(np.sqrt(np.diag(covariance))[::-1], rel=1e-9)
        assert found["max_resid"] == pytest.approx(np.max(np.abs(value - quartic(temperature_c))), rel=1e-6)
        residual = value - np.polyval(line, temperature_c)
        assert found["max_resid_linear"] == pytest.approx(np.max(np.abs(residual)), rel=1e-6)


def test_static_curved_unit(tmp_path, rng):
    columns, _ = static_columns(rng, **CURVED, noise_v=5e-7)
    result = reduced(tmp_path, "static", columns, degree=4)
    at_c = np.linspace(-40, 70, 12)
    for key, truth in (("K0", CURVED["bias_v"]), ("K1", CURVED["scale_v_per_g"])):
        model = polynomial.polyval(at_c, result[key]["poly"])
        assert model == pytest.approx(polynomial.polyval(at_c, truth), abs=1.5e-6)
    # The bias bends by more than 200 µV away from a line.
    assert result["K0"]["max_resid_linear"] > 50 * result["K0"]["max_resid"]


def test_static_head_offset_is_taken_at_the_actual_angles(tmp_path, rng):
    columns, bias_v = static_columns(rng, **LINEAR, head_deg=1.0)
    result = reduced(tmp_path, "static", columns, degree=4)
    assert [point["K0_V"] for point in result["points"]] == pytest.approx(bias_v, abs=1e-12)


@pytest.mark.parametrize("amplitude_g", [60e-6, 300e-6])
def test_static_hysteresis_with_invalid_readings(tmp_path, rng, amplitude_g):
    hysteresis_g = play_g(np.array(DEFAULT_CYCLE_C, dtype=float), THRESHOLDS_C, amplitude_g)
    columns, bias_v = static_columns(rng, **LINEAR, hysteresis_g=hysteresis_g, noise_v=1e-6)
    for row in (3, 42, 77, 130):  # one repetition of a position
        columns["valid"][row] = 0
        columns["U_V"][row] = 9.9
    columns["U_V"][101] = None
    columns["U_V"][58] = "nan"
    for row in (8 * 5 + 1, 8 * 5 + 6):  # both repetitions of 90° in dwell 5
        columns["valid"][row] = 0
    result = reduced(tmp_path, "static", columns, degree=4)
    assert result["flags"] == ["dwell 5 incomplete: 90"]
    assert result["rejected"] == {"missing": 2, "invalid": 6, "thermometer": 0, "duplicate": 0}
    points = result["points"]
    assert [point["dwell"] for point in points] == [*range(5), *range(6, 23)]
    assert [point["K0_V"] for point in points] == pytest.approx(np.delete(bias_v, 5), abs=3e-6)
    loop_v = {}
    for i in [*range(5), *range(17, 23)]:  # rising, but for dwell 5
        for j in range(6, 17):
            if DEFAULT_CYCLE_C[i] == DEFAULT_CYCLE_C[j]:
                difference = K1 * abs(hysteresis_g[i] - hysteresis_g[j])
                loop_v[DEFAULT_CYCLE_C[i]] = max(loop_v.get(DEFAULT_CYCLE_C[i], 0.0), difference)
    found = result["K0"]
    assert found["hysteresis_max"] == pytest.approx(max(loop_v.values()), rel=0.02, abs=2e-6)
    assert loop_v[found["hysteresis_at_C"]] == pytest.approx(max(loop_v.values()), rel=0.02, abs=2e-6)
    assert result["K1"]["hysteresis_max"] < 5e-6


def test_static_hysteresis_is_looked_for_within_a_cycle(tmp_path, rng):
    # The second cycle is 100 µg off as a whole: a change between cycles is no hysteresis.
    offset_g = np.repeat([0.0, 100e-6], 23)
    columns, _ = static_columns(rng, **LINEAR, cycles=2, hysteresis_g=offset_g)
    result = reduced(tmp_path, "static", columns, degree=4)
    assert [(point["cycle"], point["dwell"]) for point in result["points"]] == [(1 + i // 23, i) for i in range(46)]
    assert result["K0"]["hysteresis_max"] < 1e-6


def test_static_order_duplicates_and_blanks_change_nothing(tmp_path, rng):
    hysteresis_g = play_g(np.array(2 * DEFAULT_CYCLE_C, dtype=float), THRESHOLDS_C, 60e-6)
    columns, _ = static_columns(rng, **CURVED, cycles=2, hysteresis_g=hysteresis_g, noise_v=2e-6)
    columns["valid"][17] = 0
    expected = reduced(tmp_path, "static", columns, degree=3)
    found = reduced(tmp_path, "static", shuffled(columns, rng), degree=3)
    for point, other in zip(found["points"], expected["points"], strict=True):
        assert point.pop("leg") == other.pop("leg")
        assert point == pytest.approx(other, rel=1e-9, abs=1e-12)
    for key in ("K0", "K1"):
        assert {k: pytest.approx(v, rel=1e-6, abs=1e-15) for k, v in found[key].items()} == expected[key]
    assert found["rejected"]["duplicate"] == 53 - 1 * (17 % 7 == 0)
    assert found["rejected"]["missing"] == 5


@pytest.mark.parametrize(("set_c", "terms"), [([20, 40, 60, 40, 20], 3), ([20, 40, 20], 2), ([20, 20], 1)])
def test_static_too_few_temperatures(tmp_path, rng, set_c, terms):
    columns, _ = static_columns(rng, **LINEAR, set_c=set_c)
    result = reduced(tmp_path, "static", columns, degree=4)
    assert result["flags"] == ["K0:too_few_temperatures", "K1:too_few_temperatures"]
    assert len(result["K0"]["poly"]) == terms
    if terms > 1:
        assert result["K0"]["linear"] == pytest.approx([2.4e-4, 1.1e-5], rel=0.01)
    else:
        assert result["K0"]["linear"] is None


def test_static_temperatures_that_do_not_determine_a_model_are_flagged(tmp_path, rng):
    columns, bias_v = static_columns(rng, **LINEAR, set_c=[20, 22, 20])
    columns["T_meas_C"] = [21.0] * len(columns["T_meas_C"])
    result = reduced(tmp_path, "static", columns)
    assert result["flags"] == ["K0:ill_conditioned", "K1:ill_conditioned"]
    assert [point["K0_V"] for point in result["points"]] == pytest.approx(bias_v, abs=1e-12)
    assert (result["K0"]["poly"], result["K0"]["linear"]) == ([], None)
    assert reduced_case(tmp_path / "case.json").outcome == "INCOMPLETE"


def test_static_dwell_at_angles_that_do_not_determine_it_is_left_out(tmp_path, rng):
    """Near 45°, 135°, 225° and 315° sin² is the same at all angles, like the bias."""
    columns, bias_v = static_columns(rng, **LINEAR, head_deg=44.99)
    others, _ = static_columns(rng, **LINEAR)
    for name, column in columns.items():
        column[8:] = others[name][8:]
    result = reduced(tmp_path, "static", columns, degree=2)
    assert result["flags"] == ["dwell 0 incomplete: ill_conditioned"]
    assert len(result["points"]) == len(bias_v) - 1


def test_static_without_a_degree_finds_it(tmp_path, rng):
    columns, _ = static_columns(rng, **LINEAR, noise_v=3e-6)
    assert len(reduced(tmp_path, "static", columns)["K1"]["poly"]) == 2
    columns, _ = static_columns(rng, **CURVED, noise_v=1e-6)
    assert len(reduced(tmp_path, "static", columns)["K0"]["poly"]) >= 4


def test_tilt_meter_before_and_after_compensation(tmp_path, rng):
    temperature_c = np.linspace(-40, 60, 201)
    tilt_deg = 0.5 + 0.002 * rng.standard_normal(201)
    output_v = 3.2e-4 + 1.4e-5 * temperature_c + K1 * np.sin(np.radians(tilt_deg))
    columns = {"T_C": temperature_c.tolist(), "U_V": output_v.tolist()}
    columns["U_V"][7], columns["T_C"][8] = None, "NaN"
    used = np.delete(np.arange(201), [7, 8])
    result = reduced(tmp_path, "tilt", columns, K1_V_per_g=K1, B0_V=3.2e-4, B1_V_per_C=1.4e-5, K0_nominal_V=6e-4)
    raw_deg = np.degrees(np.arcsin((output_v[used] - 6e-4) / K1))
    assert result["raw_span_deg"] == pytest.approx(np.ptp(raw_deg), rel=1e-9)
    assert result["raw_mean_deg"] == pytest.approx(np.mean(raw_deg), rel=1e-9)
    assert result["comp_span_deg"] == pytest.approx(np.ptp(tilt_deg[used]), rel=1e-9)
    assert result["comp_mean_deg"] == pytest.approx(np.mean(tilt_deg[used]), rel=1e-9)
    assert result["flags"] == []


def test_tilt_meter_of_two_over_the_full_circle(tmp_path):
    temperature_c, tilt_deg, skew_rad = np.linspace(-40, 60, 201), 135.0, 2e-3
    own = {"K1_V_per_g": K1, "B0_V": 3.2e-4, "B1_V_per_C": 1.4e-5, "K0_nominal_V": 6e-4}
    across = {"K1_V_per_g": 0.9, "B0_V": -1e-4, "B1_V_per_C": 2e-5, "K0_nominal_V": 0.0}
    columns = {"T_C": temperature_c.tolist()}
    for name, axis, at_deg in (("U_V", own, tilt_deg), ("U_across_V", across, tilt_deg + 90 + np.degrees(skew_rad))):
        bias_v = axis["B0_V"] + axis["B1_V_per_C"] * temperature_c
        columns[name] = (bias_v + axis["K1_V_per_g"] * np.sin(np.radians(at_deg))).tolist()
    result = reduced(tmp_path, "tilt", columns, **own, across=across, skew_rad=skew_rad, u_skew_rad=1e-4)
    both = result["of_two"]
    assert both["comp_mean_deg"] == pytest.approx(tilt_deg, abs=1e-9)
    assert both["comp_span_deg"] == pytest.approx(0, abs=1e-9)
    by_biases_deg = np.degrees(np.hypot(1.4e-3 / K1, 2e-3 / 0.9))
    assert 0.2 * by_biases_deg < both["raw_span_deg"] <= by_biases_deg
    assert both["u_skew_deg"] == pytest.approx(np.degrees(1e-4) / 2, rel=0.01)
    assert "of_two" not in reduced(tmp_path, "tilt", {name: columns[name] for name in ("T_C", "U_V")}, **own)
