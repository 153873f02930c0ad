"""The largest of values along a course that scatter about it: by repeated trials of known courses."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology.extremes import scatter_sd
from bench.metrology.largest import largest_of

pytestmark = pytest.mark.lengthy

AT = np.linspace(-1, 1, 90)
COURSES = {
    "a hump": [8 * (1 - AT**2), 7 * (1 - AT**2)],
    "the end of a leg": [10 * AT**3, -9 * AT**3],
    "loops of a play": [10 * np.minimum(1, 2 * (1 - np.abs(AT))), 10 * np.minimum(1, 2 * (1 - np.abs(AT)))],
    "a jump": [np.where(AT > 0.2, -20.0, 0.0), np.zeros(len(AT))],
    "two peaks": [9 * np.sin(4 * AT), 2 * AT],
}


def trials(course, sds, count=150):
    """Errors, uncertainties and ends of intervals about the truth, (n, 4)."""
    rng, true = np.random.default_rng(5), max(float(np.max(np.abs(each))) for each in course)
    rows = []
    for _ in range(count):
        records = [each + sd * rng.standard_normal(len(each)) for each, sd in zip(course, sds, strict=True)]
        found = largest_of(records, sds)
        u = np.hypot(*(line.u for line in found.lines))
        rows.append((found.value - true, u, found.interval.low - true, found.interval.high - true))
    return np.array(rows)


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_uncertainty_and_interval_are_neither_too_small_nor_too_large(course):
    error, u, low, high = trials(course, [np.ones(len(AT)), np.ones(len(AT))]).T
    assert 0.7 < np.sqrt(np.mean((error / u) ** 2)) < 1.35
    assert np.mean((low <= 0) & (high >= 0)) >= 0.9
    assert np.mean(error - low) < 7, "with sd 1: what 180 values scatter by at most, and no more"


def test_values_that_scatter_by_amounts_of_their_own_are_known_as_well():
    sds = [np.where(np.arange(len(AT)) % 3, 0.6, 1.4), np.full(len(AT), 0.8)]
    error, u, low, high = trials(COURSES["a hump"], sds).T
    assert 0.7 < np.sqrt(np.mean((error / u) ** 2)) < 1.35
    assert np.mean((low <= 0) & (high >= 0)) >= 0.9
    assert np.mean(error - low) < 7, "with sd 1: what 180 values scatter by at most, and no more"


def test_of_scatter_alone_nothing_is_found_and_its_size_is_told():
    error, _, low, high = trials([np.zeros(len(AT))], [np.ones(len(AT))]).T
    assert np.mean(low <= 0) > 0.95
    assert np.all((high > 0) & (high < error + 2.01))


def test_a_peak_sharper_than_its_neighbours_tell_is_in_the_interval():
    course = [np.where(AT < -0.95, 10.0, 0.0), np.zeros(len(AT))]
    _, _, low, high = trials(course, [np.full(len(AT), 1.5)] * 2).T
    assert np.mean((low <= 0) & (high >= 0)) > 0.9


def test_without_scatter_the_largest_is_known():
    found = largest_of([COURSES["a hump"][0]], [np.zeros(len(AT))])
    assert (found.interval.low, found.interval.high) == pytest.approx((found.value, found.value))


@pytest.mark.parametrize("count", [1, 2, 4, 10])
def test_few_values_are_taken_as_they_are(count):
    found = largest_of([np.arange(1.0, 1.0 + count)], [np.full(count, 0.1)])
    assert found.interval.low <= count <= found.interval.high < count + 0.5


def test_scatter_is_found_in_values_with_gains_of_their_own():
    rng, gains = np.random.default_rng(6), 1 + np.arange(400) % 5
    record = 20 * np.linspace(-1, 1, 400) ** 2 + 0.7 * gains * rng.standard_normal(400)
    assert scatter_sd([record], 2, [gains]) == pytest.approx(0.7, rel=0.06)
