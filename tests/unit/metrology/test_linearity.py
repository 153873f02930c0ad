"""The curve of a sensor over its range: what is found of it, how well, and the way back."""

import numpy as np
import pytest

from bench.metrology.calibration.linearity import DEPARTURE, Linearity, LinearityPoint, fit_linearity
from bench.metrology.results.budget import BudgetLine

FULL = 400.0
TERMS = ("scale_error", "asymmetry", "cubic")
KNOWN = Linearity({"scale_error": 3e-4, "asymmetry": -1e-4, "cubic": 5e-4}, {}, (), FULL, (-FULL, FULL))
TRUE = np.array([s * r for r in (10, 50, 100, 200, 300, 400) for s in (1, -1)], dtype=float)


def points(true=TRUE, *, bias=0.0, noise=0.0, u=1e-3, bias_u=0.0, rng=None):
    away = noise * rng.standard_normal(len(true)) if rng is not None else 0.0
    reading = true * (1 + KNOWN.relative(true)) + bias + away
    lines = [BudgetLine("noise", "A", u, 40), BudgetLine("bias", "B", bias_u, None, "bias")]
    return [LinearityPoint(float(each), float(at), lines) for each, at in zip(reading, true, strict=True)]


def fitted(found, terms=TERMS):
    return fit_linearity(found, terms, FULL, frozenset({"bias"}))


def test_a_reading_goes_back_to_what_is_true():
    reading = TRUE * (1 + KNOWN.relative(TRUE))
    true, beyond = KNOWN.true(reading)
    assert true == pytest.approx(TRUE, rel=1e-14)
    assert not beyond[np.abs(TRUE) < FULL].any()
    assert KNOWN.true(np.zeros(1))[0] == [0.0]


def test_beyond_the_range_the_error_goes_on_as_at_its_end():
    (true,), (beyond,) = KNOWN.true(np.array([500.0]))
    assert true == pytest.approx(500 / (1 + 3e-4 - 1e-4 + 5e-4), rel=1e-14)
    assert beyond


def test_the_terms_are_found():
    found, _ = fitted(points())
    assert found.coefficients == pytest.approx(KNOWN.coefficients, rel=1e-9)
    assert found.valid == (-FULL, FULL)


def test_uncertainties_tell_the_errors_of_noise_and_of_one_bias():
    rng, ratios = np.random.default_rng(3), []
    for _ in range(300):
        bias = 5e-3 * rng.standard_normal()
        found, _ = fitted(points(bias=bias, noise=4e-3, u=4e-3, bias_u=5e-3, rng=rng))
        ratios.append([(found.coefficients[name] - KNOWN.coefficients[name]) / found.u[name] for name in TERMS])
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert ((rms > 0.8) & (rms < 1.15)).all(), rms


def test_a_bias_is_in_the_asymmetry_and_not_in_the_scale_factor():
    _, lines = fitted(points(bias_u=5e-3))
    u = {name: {line.source: line.u for line in of} for name, of in lines.items()}
    assert u["scale_error"]["bias"] < 1e-12
    assert u["asymmetry"]["bias"] > 1e-6
    shared = [line.shared for line in lines["asymmetry"] if line.source == "bias"]
    assert shared == ["bias"]


def test_points_that_scatter_more_than_they_should_make_it_less_certain():
    rng = np.random.default_rng(5)
    found, lines = fitted(points(noise=0.05, u=1e-3, rng=rng))
    departure = {name: next(line for line in of if line.source == DEPARTURE) for name, of in lines.items()}
    assert departure["scale_error"].u > 0.9 * found.u["scale_error"]
    assert departure["scale_error"].dof == len(TRUE) - 3
    assert abs(found.coefficients["scale_error"] - 3e-4) < 3 * found.u["scale_error"]


def test_terms_that_the_points_do_not_determine_are_left_out():
    one_sense, _ = fitted(points(np.array([50.0, 100, 200, 400])))
    assert list(one_sense.coefficients) == ["scale_error", "cubic"]
    two, _ = fitted(points(np.array([100.0, -100, 400.0])), TERMS)
    assert list(two.coefficients) == ["scale_error", "asymmetry"]
    (one, _) = fitted(points(np.array([100.0])))
    assert one.coefficients["scale_error"] == pytest.approx(KNOWN.relative(np.array([100.0]))[0], rel=1e-9)
    assert fitted([]) is None


def test_effective_degrees_of_freedom_of_a_coefficient_are_truncated():
    """Welch-Satterthwaite (JCGM 100, G.4.1) of one source with 40 or 43 degrees of freedom a point."""
    found = [
        LinearityPoint(each.reading, each.true, [BudgetLine("noise", "A", 1e-3 * (1 + 0.1 * n), 40 + 3 * (n % 2))])
        for n, each in enumerate(points())
    ]
    _, lines = fit_linearity(found, ("scale_error",), FULL, frozenset())
    (noise,) = (line for line in lines["scale_error"] if line.source == "noise")
    parts = TRUE / np.array([line.u for each in found for line in each.lines])
    dofs = np.array([line.dof for each in found for line in each.lines])
    exact = np.sum(parts**2) ** 2 / np.sum(parts**4 / dofs)
    assert exact % 1 > 0.5
    assert noise.dof == int(exact)
