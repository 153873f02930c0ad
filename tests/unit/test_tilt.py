import numpy as np
import pytest

from bench.analysis.tilt import compare_tilt

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
    assert found.flags == ("out_of_range",)
    assert found.excluded == {"missing": 2, "out_of_range": 2}


def test_a_sample_is_left_out_of_both_when_one_of_them_is_impossible():
    temperature_c = np.array([20.0, 60.0])
    found = compare_tilt(temperature_c, np.array([0.1, 1.1308]), **MODEL)  # 1.1303 V raw is beyond, compensated is not
    assert found.raw_mean_deg == found.raw_span_deg + np.degrees(np.arcsin((0.1 - 5e-4) / 1.13))
    assert found.excluded["out_of_range"] == 1


def test_no_sample_has_no_tilt():
    found = compare_tilt(np.array([np.nan]), np.array([0.1]), **MODEL)
    assert (found.raw_span_deg, found.raw_mean_deg, found.compensated_mean_deg) == (None, None, None)
    assert found.flags == ()
