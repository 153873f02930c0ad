import numpy as np
import pytest

from bench.methods.tumble.reduction.over_temperature import (
    CONTAINED,
    bias_coefficients,
    coefficient_findings,
    scale_coefficients,
)
from bench.metrology.least_squares import fit_polynomial
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Subject

SET_C = np.linspace(-40, 70, 23)
REFERENCE_C = 25.0
T1, T2, T3 = 1e-5, 3e-8, 4e-10  # g per power of °C, equations 8.7


def bias_g(temperature_c):
    away_c = temperature_c - REFERENCE_C
    return 7e-4 + T1 * away_c + T2 * away_c**2 + T3 * away_c**3


def scale_pps_per_g(temperature_c):
    away_c = temperature_c - REFERENCE_C
    return 11_300 * (1 - 58e-6 * away_c + 2e-8 * away_c**2)


@pytest.mark.parametrize("degree", [3, 4])
def test_the_coefficients_are_those_about_the_reference_temperature(degree):
    found = bias_coefficients(fit_polynomial(SET_C, bias_g(SET_C), degree), REFERENCE_C)
    assert (found.t1, found.t2) == (pytest.approx(T1, rel=1e-9), pytest.approx(T2, rel=1e-9))
    assert not found.extrapolated


def test_another_reference_temperature_has_other_coefficients():
    found = bias_coefficients(fit_polynomial(SET_C, bias_g(SET_C), 3), 35.0)
    assert found.t1 == pytest.approx(T1 + 20 * T2 + 300 * T3, rel=1e-9)
    assert found.t2 == pytest.approx(T2 + 30 * T3, rel=1e-9)


def test_those_of_the_scale_factor_are_relative_to_it_at_the_reference_temperature():
    model = fit_polynomial(SET_C, scale_pps_per_g(SET_C), 4)
    found = scale_coefficients(model, REFERENCE_C)
    assert (found.t1, found.t2) == (pytest.approx(-58e-6, rel=1e-9), pytest.approx(2e-8, rel=1e-6))
    k1 = scale_pps_per_g(35.0) / 11_300
    assert scale_coefficients(model, 35.0).t1 == pytest.approx((-58e-6 + 20 * 2e-8) / k1, rel=1e-9)


def test_a_straight_line_has_no_second_coefficient():
    noisy = bias_g(SET_C) + 1e-6 * np.random.default_rng(1).standard_normal(23)
    model = fit_polynomial(SET_C, noisy, 1)
    found = bias_coefficients(model, REFERENCE_C)
    assert found.t1 == pytest.approx(model.powers[1], rel=1e-12)
    assert model.residual_sd * np.linalg.norm(found.gain[0]) == pytest.approx(model.u_powers[1], rel=1e-12)
    assert np.isnan([found.t2, *found.gain[1]]).all()


@pytest.mark.parametrize(("at_c", "outside"), [(-40.5, True), (-40.0, False), (70.0, False), (70.5, True)])
def test_a_reference_outside_of_the_temperatures_is_told(at_c, outside):
    model = fit_polynomial(SET_C, bias_g(SET_C), 3)
    assert bias_coefficients(model, at_c).extrapolated is outside


@pytest.mark.parametrize(
    ("truth", "coefficients", "noise"),
    [(bias_g, bias_coefficients, 1e-6), (scale_pps_per_g, scale_coefficients, 20.0)],
    ids=["K0", "K1"],
)
def test_uncertainties_are_those_of_repeated_experiments(truth, coefficients, noise):
    rng = np.random.default_rng(20_240_607)
    found = [
        coefficients(fit_polynomial(SET_C, truth(SET_C) + noise * rng.standard_normal(23), 3), -10.0)
        for _ in range(1000)
    ]
    scatter = np.cov([[each.t1, each.t2] for each in found], rowvar=False)
    expected = noise**2 * found[0].gain @ found[0].gain.T
    assert np.sqrt(np.diag(expected)) == pytest.approx(np.sqrt(np.diag(scatter)), rel=0.06)
    correlations = [each[0, 1] / np.sqrt(each[0, 0] * each[1, 1]) for each in (expected, scatter)]
    assert correlations[0] == pytest.approx(correlations[1], abs=0.06)


def test_the_gain_is_what_each_value_adds():
    values = scale_pps_per_g(SET_C)
    base = scale_coefficients(fit_polynomial(SET_C, values, 3), REFERENCE_C)
    values[7] += 0.01
    moved = scale_coefficients(fit_polynomial(SET_C, values, 3), REFERENCE_C)
    assert [moved.t1 - base.t1, moved.t2 - base.t2] == pytest.approx(0.01 * base.gain[:, 7], rel=1e-4)


@pytest.mark.parametrize(
    ("truth", "coefficients"), [(bias_g, bias_coefficients), (scale_pps_per_g, scale_coefficients)], ids=["K0", "K1"]
)
@pytest.mark.parametrize("at_c", [REFERENCE_C, -30.0])
def test_what_a_wrong_thermometer_makes_of_them_is_told(truth, coefficients, at_c):
    offset_c, gain = 1e-3, 1e-5

    def found(temperature_c):
        each = coefficients(fit_polynomial(temperature_c, truth(SET_C), 4), at_c)
        return np.array([each.t1, each.t2])

    model = fit_polynomial(SET_C, truth(SET_C), 4)
    each = coefficients(model, at_c).gain * model.slope(SET_C)  # by the values that the error moves
    assert found(SET_C - offset_c) - found(SET_C) == pytest.approx(each.sum(axis=1) * offset_c, rel=1e-3)
    assert found(SET_C * (1 - gain)) - found(SET_C) == pytest.approx(each @ SET_C * gain, rel=1e-3)


def found(quantity, model, reference_c):
    """Findings of a model of values with a scatter of 0.1 µg each."""
    return coefficient_findings(
        Subject("tumble", "a", "S1"), quantity, model, reference_c, ("steps",),
        lambda gain: [BudgetLine("readings", "A", 1e-7 * float(np.linalg.norm(gain)), 100)],
    )  # fmt: skip


def test_they_become_findings_with_a_budget_each():
    values = bias_g(SET_C) + 1e-7 * np.random.default_rng(2).standard_normal(23)
    linear, quadratic = found("K0", fit_polynomial(SET_C, values, 4), REFERENCE_C)
    assert (linear.id, linear.unit, linear.flags) == ("tumble/a/K0T1", "g/°C", ())
    assert (quadratic.id, quadratic.unit, quadratic.at) == ("tumble/a/K0T2", "g/°C²", {"at_c": REFERENCE_C})
    assert linear.value == pytest.approx(T1, abs=3 * linear.u)
    assert quadratic.value == pytest.approx(T2, abs=3 * quadratic.u)
    assert {line.source for line in linear.budget} == {"readings", CONTAINED}
    (line,) = found("K1", fit_polynomial(SET_C[:2], scale_pps_per_g(SET_C[:2]), 1), 25.0)
    assert (line.quantity, line.unit, line.flags) == ("K1T1", "1/°C", ("extrapolated",))


def test_what_the_model_leaves_over_is_in_the_values_and_makes_none_uncertain():
    """Ten times as much hysteresis moves the coefficients, which are those of the unit, and not their u."""
    loop = np.where(np.arange(23) < 11, 1.0, -1.0)
    little, much = (
        next(found("K0", fit_polynomial(SET_C, bias_g(SET_C) + g * loop, 4), REFERENCE_C)) for g in (6e-6, 60e-6)
    )
    assert much.value != pytest.approx(little.value, rel=1e-3)
    assert much.u == pytest.approx(little.u)
    assert {line.source for line in much.budget} == {"readings", CONTAINED}
