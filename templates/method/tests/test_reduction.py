"""The arithmetic against a known truth: errors are as large as stated."""

import numpy as np
import pytest

from toy_rest.reduction import line_of

MEAN, DRIFT_PER_H, SD, COUNT, SEEDS = 11_300.0, 2e-5, 0.02, 20, 400


def readings(seed, bend=0.0):
    rng = np.random.default_rng(seed)
    time_s = 1000 + 10.5 * np.arange(COUNT)
    hours = (time_s - time_s.mean()) / 3600
    return time_s, MEAN * (1 + DRIFT_PER_H * hours + bend * hours**2) + rng.normal(0, SD, COUNT)


def test_a_line_without_noise_is_found_as_it_is():
    time_s = 100 + 10.0 * np.arange(12)
    rest = line_of(time_s, 5.0 + 0.25 * (time_s - time_s.mean()) / 3600)
    assert rest.mean == pytest.approx(5.0)
    assert rest.slope_per_h == pytest.approx(0.25)
    assert rest.sd == pytest.approx(0.0, abs=1e-12)


def test_errors_are_as_large_as_their_uncertainties():
    found = [line_of(*readings(seed)) for seed in range(SEEDS)]
    mean = np.array([(rest.mean - MEAN) / rest.mean_u for rest in found])
    slope = np.array([(rest.slope_per_h - MEAN * DRIFT_PER_H) / rest.slope_u_per_h for rest in found])
    expected = np.sqrt((COUNT - 2) / (COUNT - 4))  # of Student's t with n - 2 degrees of freedom
    for normalised in (mean, slope):
        assert abs(np.mean(normalised)) < 4 * expected / np.sqrt(SEEDS)
        assert np.std(normalised) == pytest.approx(expected, rel=0.15)


def test_a_curve_is_seen_and_a_line_is_not_taken_for_one():
    assert all(line_of(*readings(seed, bend=0.05)).is_curved for seed in range(20))
    assert sum(line_of(*readings(seed)).is_curved for seed in range(SEEDS)) < 0.03 * SEEDS
