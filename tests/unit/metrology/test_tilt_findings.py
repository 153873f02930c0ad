"""The span of tilt that a drifting bias makes, and how well it is known."""

import numpy as np
import pytest

from bench.metrology.extremes import span_u
from bench.metrology.results.finding import Subject
from bench.metrology.tilt_findings import TiltOrigin, tilt_findings

TEMPERATURE_C = np.linspace(-40, 60, 21)
BIAS_G = 2.4e-4 + 1.1e-5 * TEMPERATURE_C


def found(bias_g, modelled_g, sd_g=1e-6, **changed):
    origin = TiltOrigin(Subject("tumble", "a", "QF-1"), ("steps",), sd_g, 20, **changed)
    return {each.quantity: each for each in tilt_findings(bias_g, modelled_g, origin)}


def test_the_span_is_what_the_bias_drifts_over_the_temperatures_and_the_model_takes_it():
    spans = found(BIAS_G, BIAS_G, sd_g=0.0)
    # equations 6.5: 1.1e-5 g/°C over 100 °C
    assert spans["tilt/uncompensated"].value == pytest.approx(np.degrees(1.1e-3), rel=1e-6)
    assert spans["tilt/compensated"].value == pytest.approx(0.0, abs=1e-12)
    assert spans["tilt/uncompensated"].id == "tumble/a/tilt/uncompensated"


def test_a_constant_of_the_bias_has_no_part_in_it():
    higher = found(BIAS_G + 0.01, BIAS_G + 0.01, sd_g=0.0)["tilt/uncompensated"].value
    assert higher == pytest.approx(np.degrees(1.1e-3), rel=1e-4)


def test_its_uncertainty_covers_what_scatter_makes_of_a_span():
    rng, sd_g, ratios, inside = np.random.default_rng(7), 20e-6, [], 0
    for _ in range(200):
        bias_g = BIAS_G + sd_g * rng.standard_normal(len(BIAS_G))
        spans = found(bias_g, BIAS_G, sd_g=sd_g)
        ratios.append([
            (spans["tilt/uncompensated"].value - np.degrees(1.1e-3)) / spans["tilt/uncompensated"].u,
            spans["tilt/compensated"].value / spans["tilt/compensated"].u,
        ])  # fmt: skip
        interval = spans["tilt/uncompensated"].interval
        inside += interval.low <= np.degrees(1.1e-3) <= interval.high and spans["tilt/compensated"].interval.low == 0
    assert inside >= 180, "either is so in 95 of 100"
    uncompensated, compensated = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert 0.7 < uncompensated < 1.3
    assert compensated < 1.3, "all of the span is scatter, and its budget says so"


def test_the_budget_names_the_scale_factor_and_what_is_contained():
    spans = found(BIAS_G, BIAS_G + 1e-6, scale_u=1e-3, scale_shared="ramp/a/K1", contained="lag: contained")
    shares = {line.source: line for line in spans["tilt/uncompensated"].budget}
    assert shares["K1: misalignment in it"].u == pytest.approx(1e-3 * spans["tilt/uncompensated"].value)
    assert {line.source for line in spans["tilt/compensated"].budget if line.type == "alias"} == {"lag: contained"}


def test_one_temperature_or_a_bias_beyond_1_g_has_no_span():
    assert found(BIAS_G[:1], BIAS_G[:1]) == {}
    assert found(np.array([-2.0, 2.0]), np.zeros(2)) == {}


def test_the_scatter_of_a_span_of_equal_values_is_its_whole_expectation():
    sd, excess = span_u(np.zeros(21), 1.0)
    assert excess == pytest.approx(3.78, abs=0.15)  # mean range of 21 normal deviates
    assert 0.5 < sd < 0.9
