import numpy as np
import pytest

from bench.analysis.extremes import largest_u, scatter_sd


@pytest.fixture
def rng():
    return np.random.default_rng(20_261_121)


def test_scatter_is_told_from_what_is_smooth_and_from_jumps(rng):
    x = np.linspace(-1, 1, 2000)
    record = 50 * x**3 + np.where(x > 0.3, 200.0, 0.0) + 2.5 * rng.standard_normal(2000)
    assert scatter_sd([record]) == pytest.approx(2.5, rel=0.06)
    assert scatter_sd([record[:900], record[900:]], stride=2) == pytest.approx(2.5, rel=0.06)


def test_an_error_that_neighbours_share_is_passed_over(rng):
    edges = rng.uniform(0, 1, 5001)
    counted = np.diff(edges)  # what one sample counts too much the next counts too little
    assert scatter_sd([counted], stride=2) == pytest.approx(np.std(counted), rel=0.08)
    assert scatter_sd([counted], stride=1) > 1.2 * np.std(counted)


def test_too_few_values_tell_no_scatter():
    assert np.isnan(scatter_sd([np.arange(6.0)]))
    assert np.isnan(scatter_sd([]))
    assert scatter_sd([np.arange(7.0)]) == pytest.approx(0, abs=1e-12)


SHAPES = {
    "nothing": np.zeros(200),
    "hump": 30 * np.sin(np.linspace(0, np.pi, 200)),
    "step": np.where(np.arange(200) > 77, -40.0, 0.0),
    "low hump": 2 * np.sin(np.linspace(0, np.pi, 200)),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_the_error_of_a_largest_value_is_as_large_as_its_uncertainty(rng, shape):
    calm, ratios = SHAPES[shape], []
    for _ in range(150):
        values = calm + rng.standard_normal(200)
        error = np.max(np.abs(values)) - np.max(np.abs(calm))
        ratios.append(error / np.hypot(*largest_u(values, 1.0)))
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_equal_values_give_equal_uncertainties(rng):
    values = rng.standard_normal(50)
    assert largest_u(values, 0.5) == largest_u(values.copy(), 0.5)
    assert largest_u(values, 0.0) == pytest.approx((0.0, 0.0))
