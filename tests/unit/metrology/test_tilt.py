import numpy as np
import pytest

from bench.metrology.tilt import TiltAxis, TiltModel, compare_tilt, compare_tilt_of_two, tilt_of_one, tilt_of_two

MODEL = {"scale_v_per_g": 1.13, "nominal_bias_v": 5e-4, "bias_v": (3.2e-4, 1.4e-5)}


def output_v(tilt_deg, temperature_c):
    return 3.2e-4 + 1.4e-5 * temperature_c + 1.13 * np.sin(np.radians(tilt_deg))


def test_the_model_takes_the_temperature_out():
    temperature_c = np.linspace(-40, 60, 11)
    found = compare_tilt(temperature_c, output_v(2.0, temperature_c), **MODEL)
    assert found.compensated_span_deg == pytest.approx(0, abs=1e-12)
    assert found.compensated_mean_deg == pytest.approx(2.0, rel=1e-12)
    # 1.4e-5 V/°C over 100 °C at 1.13 V/g is 1.239 mg, at 2° that is 0.0710°.
    assert found.raw_span_deg == pytest.approx(np.degrees(1.4e-3 / 1.13 / np.cos(np.radians(2))), rel=1e-4)
    assert found.raw_mean_deg == pytest.approx(2.0 + np.degrees((3.2e-4 + 1.4e-4 - 5e-4) / 1.13), abs=1e-4)
    assert found.flags == ()


def test_what_is_missing_or_beyond_the_vertical_is_left_out():
    temperature_c = np.array([20.0, np.nan, 20, 20, 20])
    output = np.array([output_v(1.0, 20.0), 0.1, np.nan, 1.14, -1.14])
    found = compare_tilt(temperature_c, output, **MODEL)
    assert found.compensated_mean_deg == pytest.approx(1.0)
    assert (found.raw_span_deg, found.compensated_span_deg) == (0, 0)
    assert found.flags == ("out_of_range", "too_few_temperatures")
    assert found.excluded == {"missing": 2, "thermometer": 0, "out_of_range": 2}


def test_a_sample_is_left_out_of_both_when_one_of_them_is_impossible():
    temperature_c = np.array([20.0, 60.0])
    found = compare_tilt(temperature_c, np.array([0.1, 1.1308]), **MODEL)  # 1.1303 V raw is beyond, compensated is not
    assert found.raw_mean_deg == found.raw_span_deg + np.degrees(np.arcsin((0.1 - 5e-4) / 1.13))
    assert found.excluded["out_of_range"] == 1


def test_no_sample_has_no_tilt():
    found = compare_tilt(np.array([np.nan]), np.array([0.1]), **MODEL)
    assert (found.raw_span_deg, found.raw_mean_deg, found.compensated_mean_deg) == (None, None, None)
    assert found.flags == ("too_few_temperatures",)


# Uncertainty, and two accelerometers

ALONG = TiltAxis(scale_v_per_g=1.13, bias_v=5e-4, u_scale_v_per_g=2e-4, u_bias_v=6e-5, u_output_v=3e-5)
ACROSS = TiltAxis(scale_v_per_g=-0.97, bias_v=-3e-3, u_scale_v_per_g=3e-4, u_bias_v=4e-5, u_output_v=5e-5)
SKEW_RAD, U_SKEW_RAD = 0.02, 1e-4
CIRCLE_DEG = np.array([-179.0, -135, -90, -60, -20, 0, 20, 45, 90, 110, 150, 180])
TRIALS = 4000


def outputs_v(tilt_deg, g=1.0, skew_rad=SKEW_RAD):
    """What both put out at a tilt, by the definition of the axes; `g` as a share of the local one."""
    tilt_rad = np.radians(tilt_deg)
    up = np.sin(tilt_rad), np.sin(tilt_rad + np.pi / 2 + skew_rad)
    return [axis.bias_v + axis.scale_v_per_g * g * each for axis, each in zip((ALONG, ACROSS), up, strict=True)]


def drawn(rng, axis, output_v):
    """Specific force as axes would tell it that are calibrated as well as `axis` is: (trials, n)."""
    bias, scale, output = rng.standard_normal((3, TRIALS, 1))
    scale_v_per_g = axis.scale_v_per_g + axis.u_scale_v_per_g * scale
    return (output_v + axis.u_output_v * output - axis.bias_v - axis.u_bias_v * bias) / scale_v_per_g


def test_one_accelerometer_tells_up_to_90_degrees():
    tilt_deg = np.array([-89.0, -30, 0, 2, 60])
    found = tilt_of_one(ALONG, outputs_v(tilt_deg)[0])
    assert found.tilt_deg == pytest.approx(tilt_deg, abs=1e-10)
    beyond = tilt_of_one(ALONG, np.array([1.14]))
    assert np.isnan([beyond.tilt_deg, beyond.u_deg]).all()
    at_the_end = tilt_of_one(TiltAxis(1.0, 0.0, 0.0, 1e-5, 0.0), np.array([1.0]))
    assert at_the_end.tilt_deg == 90.0
    assert at_the_end.u_deg > 1e6


def test_the_uncertainty_of_one_is_that_of_many_calibrations():
    tilt_deg = np.array([-80.0, -45, 0, 10, 60])
    (along_v, _), rng = outputs_v(tilt_deg), np.random.default_rng(1)
    tilts_deg = np.degrees(np.arcsin(drawn(rng, ALONG, along_v)))
    assert tilt_of_one(ALONG, along_v).u_deg == pytest.approx(np.std(tilts_deg, axis=0), rel=0.06)


@pytest.mark.parametrize("skew_rad", [0.0, SKEW_RAD, -0.3])
def test_two_accelerometers_tell_the_full_circle_whatever_g_is(skew_rad):
    along_v, across_v = outputs_v(CIRCLE_DEG, g=0.998, skew_rad=skew_rad)
    found = tilt_of_two(ALONG, ACROSS, along_v, across_v, skew_rad=skew_rad, u_skew_rad=0.0)
    away_deg = (found.tilt_deg - CIRCLE_DEG + 180) % 360 - 180
    assert away_deg == pytest.approx(np.zeros(12), abs=1e-10)


@pytest.mark.parametrize("skew_rad", [SKEW_RAD, -0.4])
def test_the_uncertainty_of_two_is_that_of_many_calibrations(skew_rad):
    (along_v, across_v), rng = outputs_v(CIRCLE_DEG, skew_rad=skew_rad), np.random.default_rng(2)
    a, b = drawn(rng, ALONG, along_v), drawn(rng, ACROSS, across_v)
    drawn_rad = skew_rad + U_SKEW_RAD * rng.standard_normal((TRIALS, 1))
    tilts_deg = np.degrees(np.arctan2(a * np.cos(drawn_rad), b + a * np.sin(drawn_rad)))
    away_deg = (tilts_deg - CIRCLE_DEG + 180) % 360 - 180
    found = tilt_of_two(ALONG, ACROSS, along_v, across_v, skew_rad=skew_rad, u_skew_rad=U_SKEW_RAD)
    assert found.u_deg == pytest.approx(np.std(away_deg, axis=0), rel=0.06)


def test_near_the_vertical_two_accelerometers_know_what_one_does_not():
    along_v, across_v = outputs_v(np.array([0.0, 89.0]))
    one = tilt_of_one(ALONG, along_v)
    two = tilt_of_two(ALONG, ACROSS, along_v, across_v, skew_rad=SKEW_RAD, u_skew_rad=0.0)
    assert two.u_deg[0] == pytest.approx(one.u_deg[0], rel=1e-3)
    assert two.u_deg[1] < one.u_deg[1] / 50


@pytest.mark.parametrize("tilt_deg", [-179.99, -90.0, 2.0, 89.0, 150.0])
def test_both_models_take_the_temperature_out_of_the_tilt_by_both_at_any_tilt(tilt_deg):
    temperature_c = np.append(np.linspace(-40, 60, 11), np.nan)
    models = (TiltModel(1.13, 5e-4, (3.2e-4, 1.4e-5)), TiltModel(-0.97, 0.0, (-1e-4, -2e-5)))
    axes_rad = np.radians(tilt_deg) + np.array([0.0, np.pi / 2 + SKEW_RAD])
    outputs = tuple(
        model.bias_v[0] + model.bias_v[1] * np.nan_to_num(temperature_c) + model.scale_v_per_g * np.sin(axis_rad)
        for model, axis_rad in zip(models, axes_rad, strict=True)
    )
    found = compare_tilt_of_two(temperature_c, outputs, models, skew_rad=SKEW_RAD, u_skew_rad=U_SKEW_RAD)
    assert found.compensated_span_deg == pytest.approx(0, abs=1e-9)
    assert found.compensated_mean_deg == pytest.approx(tilt_deg)
    assert 0.03 < found.raw_span_deg < 0.15
    sines = np.sin(axes_rad[0]) * np.sin(axes_rad[0] + SKEW_RAD)
    assert found.u_skew_deg == pytest.approx(abs(np.degrees(U_SKEW_RAD) * sines / np.cos(SKEW_RAD)), rel=1e-6)
    exchanged = compare_tilt_of_two(temperature_c, outputs[::-1], models[::-1], skew_rad=SKEW_RAD, u_skew_rad=0.0)
    assert abs(exchanged.compensated_mean_deg - tilt_deg) > 0.5 or tilt_deg == pytest.approx(45)


def test_without_a_sample_of_both_there_is_no_tilt_by_both():
    model = TiltModel(1.13, 0.0, (0.0, 0.0))
    nothing = np.array([np.nan])
    found = compare_tilt_of_two(np.array([20.0]), (np.array([0.1]), nothing), (model, model), skew_rad=0, u_skew_rad=0)
    assert (found.raw_span_deg, found.u_skew_deg) == (None, None)
