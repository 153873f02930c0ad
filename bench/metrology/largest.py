"""Largest of many scattering values along a curve, such as the temperatures of a ramp.

Neighbours along the curve give the values without scatter. Adding scatter again (Monte Carlo, JCGM 101) shows the bias
of the largest value and its standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import Interval

TRIALS = 200
WINDOW = 25  # neighbours of a parabola for a value without scatter
DEGREE = 2
MISFIT_SIGMAS = 5.0  # of the mean square in a window: limit for scatter alone
TAILS = 0.25  # relative to the bias of the largest: errors of counts are bounded by one count, others have longer tails


@dataclass(frozen=True, slots=True)
class Largest:
    """Largest |value|; `lines` and `interval` are from the scatter alone."""

    value: float
    lines: tuple[BudgetLine, ...]
    interval: Interval


def largest_of(records: Sequence[Array], sds: Sequence[Array]) -> Largest:
    """Largest |value| of records, each (n,) along its curve, with independent standard deviations `sds` (n,).

    Scatter left in the curve biases its largest value too, by the amount found in the trials. A peak may be sharper
    than the curve: the upper end allows for any single value to be the largest.
    """
    values, sd = np.concatenate(records), np.concatenate(sds)
    smoothers = [_smoother(*each) for each in zip(records, sds, strict=True)]
    smooth = _smoothed(values, smoothers)
    left = np.concatenate([each**2 @ own**2 for each, own in zip(smoothers, sds, strict=True)])
    square = float(np.mean(smooth**2))
    shrunk = float(np.sqrt(max(1 - float(np.mean(left)) / square, 0.0))) if square else 1.0
    errors = sd * np.random.default_rng(0).standard_normal((TRIALS, len(values)))
    course = shrunk * smooth
    found = course + errors
    again = shrunk * _smoothed(found, smoothers)
    largest, of_course, of_again = (np.max(np.abs(each), axis=-1) for each in (found, course, again))
    by_scatter = float(np.std(largest, ddof=1))
    by_selection = float(np.mean(largest) - of_course + max(np.mean(of_again) - of_course, 0.0))
    lines = (
        BudgetLine("samples: scatter", "A", by_scatter),
        BudgetLine("samples: scatter makes the largest of many larger", "A", by_selection),
    )
    value, least = float(np.max(np.abs(values))), by_selection + COVERAGE * np.hypot(by_scatter, TAILS * by_selection)
    low, high = max(value - float(least), 0.0), float(np.max(np.abs(values) + COVERAGE * sd))
    return Largest(value, lines, Interval(low, high, float(np.mean(np.max(np.abs(errors), axis=-1)))))


def _smoothed(values: Array, smoothers: Sequence[Array]) -> Array:
    """Values (..., n) of all records, each smoothed by its own matrix."""
    ends = np.cumsum([len(each) for each in smoothers])[:-1]
    parts = zip(np.split(values, ends, axis=-1), smoothers, strict=True)
    return np.concatenate([part @ smoother.T for part, smoother in parts], axis=-1)


def _smoother(values: Array, sd: Array) -> Array:
    """Smoothing matrix (n, n) of values (n,).

    Each value is that of a parabola through the window about it. If its residuals exceed `sd`, because of a jump or a
    corner, a one-sided window is used.
    """
    count, window = len(values), min(WINDOW, len(values))
    if window <= DEGREE + 1:
        return np.eye(count)
    design = np.vander(np.arange(window) / window, DEGREE + 1)
    hat, spare = design @ np.linalg.pinv(design), window - DEGREE - 1
    parts, sds = (sliding_window_view(each, window) for each in (values, sd))
    with np.errstate(divide="ignore", invalid="ignore"):  # without scatter there is no smoothing
        misfit = np.sum(((parts - parts @ hat) / sds) ** 2, axis=-1) / spare
    fits, half = misfit <= 1 + MISFIT_SIGMAS * np.sqrt(2 / spare), (window - 1) // 2
    found = np.zeros((count, count))
    for row in range(count):
        begins = [min(max(row - half + aside, 0), count - window) for aside in (0, half, -half)]
        begin = next((each for each in begins if fits[each]), begins[0])
        found[row, begin : begin + window] = hat[row - begin]
    return found
