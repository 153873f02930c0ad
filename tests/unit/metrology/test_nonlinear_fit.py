import numpy as np
import pytest

from bench.methods.rate_table.reduction import second_order
from bench.metrology.least_squares import NotDetermined, least_squares
from bench.metrology.nonlinear import NotConverged, fit_nonlinear
from tests.support.strd_nonlinear import MODELS, reference, with_jacobian


@pytest.mark.parametrize("name", MODELS)
def test_reference_sets_of_nist(name):
    known = reference(name)
    fit = fit_nonlinear(with_jacobian(MODELS[name], known.x), known.y, known.start)
    # Certified to 11 digits; equations 1.8 asks for 6.
    assert np.max(np.abs(fit.parameters / known.parameters - 1)) < 1e-6
    assert np.max(np.abs(fit.u / known.deviations - 1)) < 1e-6
    assert np.sum(fit.residuals**2) == pytest.approx(known.residual_sum, rel=1e-9)
    assert fit.linear.rank == len(known.start)
    assert fit.linear.dof == len(known.y) - len(known.start)


def exponential(x):
    """b0 exp(-b1 x)."""

    def model(b):
        decay = np.exp(-b[1] * x)
        return b[0] * decay, np.stack([decay, -b[0] * x * decay], axis=-1)

    return model


def test_a_linear_model_is_the_linear_fit():
    rng = np.random.default_rng(1)
    design = np.stack([np.ones(9), np.arange(9.0)], axis=-1)
    y = rng.standard_normal(9)
    fit = fit_nonlinear(lambda b: (design @ b, design), y, np.array([50.0, -3.0]))
    linear = least_squares(design, y)
    assert fit.parameters == pytest.approx(linear.coefficients, rel=1e-12)
    assert fit.covariance == pytest.approx(linear.covariance, rel=1e-12)
    assert fit.iterations == 2  # the second finds nothing left to do


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e7])
def test_exact_readings_of_parameters_that_are_zero_end_the_search(size):
    x = np.linspace(0, 3, 20)

    def model(b):
        return size * (np.sin(x + b[0]) + b[1] * x**2), size * np.stack([np.cos(x + b[0]), x**2], axis=-1)

    fit = fit_nonlinear(model, size * np.sin(x), np.array([0.3, 0.2]))
    assert fit.parameters == pytest.approx([0, 0], abs=1e-15)
    assert fit.iterations < 8


def test_no_more_readings_than_parameters_have_a_solution_and_no_scatter():
    x = np.array([0.0, 1.0])
    fit = fit_nonlinear(exponential(x), np.array([2.0, 1.0]), np.array([1.0, 1.0]))
    assert fit.parameters == pytest.approx([2.0, np.log(2)], rel=1e-12)
    assert np.isnan(fit.u).all()


def test_a_step_that_overshoots_is_shortened():
    def model(b):
        return np.arctan(b), 1 / (1 + b[:, np.newaxis] ** 2)

    # The full steps of Newton's method run away from 10; it is the classic example.
    fit = fit_nonlinear(model, np.array([0.0]), np.array([10.0]))
    assert fit.parameters == pytest.approx([0.0], abs=1e-12)


def test_what_is_not_determined_is_named():
    def product(b):  # only b0 b1 is determined
        return np.full(5, b[0] * b[1]) + b[2] * np.arange(5), np.stack(
            [np.full(5, b[1]), np.full(5, b[0]), np.arange(5.0)], axis=-1
        )

    with pytest.raises(NotDetermined, match="scale and gain are not determined") as caught:
        fit_nonlinear(product, np.arange(5.0), np.array([1.0, 1.0, 0.0]), names=("scale", "gain", "slope"))
    assert caught.value.rank == 2


def test_a_doubtful_fit_stands_and_says_so():
    x = np.linspace(1.0, 1.001, 20)
    y = 3 * np.exp(-0.5 * x)
    fit = fit_nonlinear(exponential(x), y, np.array([2.5, 0.4]), names=("height", "decay"))
    assert fit.parameters == pytest.approx([3, 0.5], rel=1e-6)
    assert fit.doubt is not None
    assert fit.doubt.names == ("height", "decay")
    assert fit.linear.condition > 1e3
    assert fit_nonlinear(exponential(x), y, np.array([2.5, 0.4]), condition_limit=1e6).doubt is None


def test_a_model_that_is_not_finite_where_the_fit_begins():
    with pytest.raises(NotConverged, match="no finite values where the fit begins"):
        fit_nonlinear(exponential(np.arange(5.0)), np.ones(5), np.array([1.0, -1e6]))


def test_a_wrong_jacobian_finds_nothing():
    def model(b):
        return b * np.ones(5), -np.ones((5, 1))

    with pytest.raises(NotConverged, match="no step makes the residuals smaller"):
        fit_nonlinear(model, np.arange(5.0), np.array([10.0]))


def test_a_search_without_end_is_given_up():
    def model(b):  # each step doubles b; the solution is at infinity
        return 1 / b, -1 / b[:, np.newaxis] ** 2

    with pytest.raises(NotConverged, match="still change after 200 steps"):
        fit_nonlinear(model, np.array([0.0]), np.array([1.0]))


def test_uncertainties_are_those_of_repeated_experiments():
    rng = np.random.default_rng(2)
    x = np.linspace(0, 3, 25)
    truth = np.array([2.0, 0.7])
    fits = [
        fit_nonlinear(exponential(x), exponential(x)(truth)[0] + 0.01 * rng.standard_normal(25), np.array([1.0, 0.5]))
        for _ in range(300)
    ]
    relative = np.array([(fit.parameters - truth) / fit.u for fit in fits])
    assert np.sqrt(np.mean(relative**2, axis=0)) == pytest.approx([1.0, 1.0], abs=0.12)


def test_a_fit_ends_where_a_step_would_improve_it_by_less_than_rounding():
    """Readings known to 2e-4 of themselves: the sum of their squares is rounded before the parameters stand still."""
    frequency_hz, u = np.array([10.37, 30.37, 57.37, 61.37, 90.37]), 2e-4
    middle_hz = float(np.mean(frequency_hz))
    true = np.array([1.0, 59.4 / middle_hz, 0.7, -5.8e-5 * middle_hz])
    model = second_order._model(frequency_hz / middle_hz, np.full(5, 1 / u))
    exact = second_order.second_order(frequency_hz, 1.0, 59.4, 0.7, -5.8e-5)
    for seed in range(600):
        parts = np.random.default_rng(seed).standard_normal((2, 5)) * u
        response = exact + parts[0] + 1j * parts[1]
        start = second_order._start(frequency_hz, response, middle_hz)
        fit = fit_nonlinear(model, np.r_[response.real, response.imag] / u, start)
        assert np.all(np.abs(fit.parameters - true) < 10 * fit.u)
