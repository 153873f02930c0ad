import numpy as np
import pytest

from bench.metrology.extremes import interval_of_largest, interval_of_rms, largest_u, scatter_sd


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


@pytest.mark.parametrize("count", [4, 40])
@pytest.mark.parametrize("height", [0.0, 1.0, 3.0, 30.0])
@pytest.mark.parametrize("shape", ["smooth", "one of many", "alike"])
def test_an_interval_holds_what_is_true_of_a_largest_value(rng, shape, height, count):
    shapes = {
        "smooth": np.cos(np.linspace(0, np.pi, count)),
        "one of many": np.eye(count)[1],
        "alike": np.ones(count),
    }
    sd = np.linspace(0.5, 1.0, count)
    held = 0
    for _ in range(200):
        found = interval_of_largest(height * shapes[shape] + sd * rng.standard_normal(count), sd)
        held += found.low <= height <= found.high
    assert held >= 186, "of 190 expected at the least; 186 is two standard deviations below"


def test_an_interval_is_no_wider_than_scatter_makes_it(rng):
    values = 50.0 + rng.standard_normal(100)
    found = interval_of_largest(values, 1.0)
    assert found.high == pytest.approx(values.max() + 1.96, abs=0.01)
    assert values.max() - 4 < found.low < values.max() - 3


def test_what_scatter_alone_makes_of_a_largest_value_is_as_in_trials(rng):
    sd = np.repeat([1.0, 3.0], 20)
    trials = np.max(np.abs(sd * rng.standard_normal((20_000, 40))), axis=1)
    found = interval_of_largest(np.zeros(40), sd)
    assert found.from_scatter == pytest.approx(trials.mean(), rel=0.01)
    bound = 100.0 - interval_of_largest(np.r_[100.0, np.zeros(39)], sd).low
    assert bound == pytest.approx(np.quantile(trials, 0.975), rel=0.02)


def test_without_scatter_the_interval_is_the_value_itself():
    found = interval_of_largest(np.array([-3.0, 2.0]), 0.0)
    assert (found.low, found.high, found.from_scatter) == (3.0, 3.0, 0.0)
    assert interval_of_largest(np.array([-3.0]), 1.0).times(-2.0).high == pytest.approx(2 * (3 + 1.96), abs=0.001)


@pytest.mark.parametrize("height", [0.0, 0.3, 5.0])
def test_the_interval_of_a_root_mean_square_holds_what_it_is_without_scatter(height):
    rng = np.random.default_rng(12)
    calm = height * np.sin(np.linspace(0, 9, 200))
    true = float(np.sqrt(np.mean(calm**2)))
    found = [interval_of_rms(calm + rng.standard_normal(200), 1.0) for _ in range(400)]
    held = np.mean([each.low <= true <= each.high for each in found])
    assert 0.92 < held <= 1.0
    assert {each.from_scatter for each in found} == {1.0}
    assert np.mean([each.high for each in found]) < true + 0.55
