"""Uncertainty and bias of a largest value of scattering values.

The largest of many scattering values is biased: the scatter has increased it. The bias is found by a Monte Carlo method
(JCGM 101): the values without scatter are estimated, then scatter is added again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import scipy

from bench.metrology.least_squares import SIGMA_PER_MAD, Array
from bench.metrology.results.finding import CONFIDENCE, Interval

TRIALS = 200
NEIGHBOURS = 15  # values whose mean is an estimate of a value without scatter
SECOND_DIFFERENCE_SD = np.sqrt(6.0)  # of 1, -2, 1 times values with a standard deviation of 1
FAR_SIGMAS = 3.0  # from this ratio on it is a jump or a corner
GRID_SIGMAS = 8.0  # upper end of the distribution of a largest error: of 1e9 errors none is larger
GRID_POINTS = 2000
SD_KNOWN = 0.05  # relative standard uncertainty of a standard deviation from second differences
FEWEST = 5  # minimum number of second differences for a median


def scatter_sd(records: Sequence[Array], stride: int = 1, gains: Sequence[Array] | None = None) -> float:
    """Standard deviation of the rough part of records of equidistant values, each (n,); NaN if too short.

    From their second differences over `stride` values, without those far beyond the median, so that a few jumps do not
    count. A stride of 2 avoids errors shared by neighbours, such as a count that one has more and the next has less.
    The scatter of each value may be the result times its gain in `gains` (n,).
    """
    usual_sd = [np.ones(len(record)) for record in records] if gains is None else gains
    curved = [
        (record[2 * stride :] - 2 * record[stride:-stride] + record[: -2 * stride])
        * (SECOND_DIFFERENCE_SD / np.sqrt(sd[2 * stride :] ** 2 + 4 * sd[stride:-stride] ** 2 + sd[: -2 * stride] ** 2))
        for record, sd in zip(records, usual_sd, strict=True)
    ]
    differences = np.abs(np.concatenate([np.zeros(0), *curved]))
    if len(differences) < FEWEST:
        return float("nan")
    usual = SIGMA_PER_MAD * float(np.median(differences))  # of counts, possibly no finer than one count
    calm = differences[differences <= FAR_SIGMAS * usual] if usual else differences
    return float(np.sqrt(np.mean(calm**2)) / SECOND_DIFFERENCE_SD)


def largest_u(values: Array, sd: float) -> tuple[float, float]:
    """Standard uncertainties of the largest |value| of (n,) with standard deviation `sd`: from scatter, from the bias.

    The values without scatter are estimated by means of neighbours, all reduced by the scatter left in them: to zero if
    all is scatter, hardly changed if there is none. Equal values give equal results.
    """
    return _extreme_u(_denoised(values, sd), sd, lambda all_values: np.max(np.abs(all_values), axis=-1))


def span_u(values: Array, sd: float) -> tuple[float, float]:
    """The same for the span of (n,), the largest value minus the smallest."""
    return _extreme_u(_denoised(values - np.mean(values), sd), sd, lambda all_values: np.ptp(all_values, axis=-1))


def _extreme_u(calm: Array, sd: float, extreme: Callable[[Array], Array]) -> tuple[float, float]:
    found = extreme(calm + sd * np.random.default_rng(0).standard_normal((TRIALS, len(calm))))
    return float(np.std(found, ddof=1)), float(np.mean(found) - extreme(calm))


def interval_of_largest(values: Array, sd: Array | float) -> Interval:
    """Range of the largest |value| of (n,) with standard deviations `sd`, one or (n,).

    It holds whatever the values without scatter are. It cannot exceed every |value| by more than the scatter of that
    one, nor can it be less than the largest by more than the largest scatter of all. Each holds at 97.5 %; the first
    for any correlation of the scatter, the second for independent scatter and all the more for positively correlated
    scatter.
    """
    sds = np.broadcast_to(np.asarray(sd, np.float64), values.shape)
    one_sided = (1 + CONFIDENCE) / 2
    high = float(np.max(np.abs(values) + scipy.special.ndtri(one_sided) * sds))
    expected, most = _largest_scatter(tuple(sds.tolist()), one_sided)
    return Interval(max(float(np.max(np.abs(values))) - most, 0.0), high, expected)


@lru_cache(maxsize=64)  # a fine grid each time, and repeated trials ask for the same
def _largest_scatter(sd: tuple[float, ...], probability: float) -> tuple[float, float]:
    """Mean of the largest |error| of independent normal errors, and its quantile at a probability."""
    widths, counts = np.unique(sd, return_counts=True)
    largest = float(widths[-1])
    if not largest:
        return 0.0, 0.0
    limit = np.linspace(0, GRID_SIGMAS * largest, GRID_POINTS)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = np.where(widths > 0, scipy.special.erf(limit[:, np.newaxis] / (widths * np.sqrt(2))), 1.0)
    below = np.prod(inside**counts, axis=1)
    return float(np.trapezoid(1 - below, limit)), float(np.interp(probability, below, limit))


def interval_of_span(values: Array, sd: float) -> Interval:
    """Range of the span of (n,) with standard deviations `sd`, whatever the values without scatter.

    No two values differ by more than here plus their scatter; the span cannot be less than this one by more than that
    of as many errors. Each holds at 97.5 %.
    """
    spans = np.ptp(sd * np.random.default_rng(0).standard_normal((TRIALS, len(values))), axis=-1)
    one_sided, span = (1 + CONFIDENCE) / 2, float(np.ptp(values))
    low = max(span - float(np.quantile(spans, one_sided)), 0.0)
    return Interval(low, span + float(scipy.special.ndtri(one_sided) * np.sqrt(2) * sd), float(np.mean(spans)))


def interval_of_rms(values: Array, sd: float, along_u: float | None = None) -> Interval:
    """Range of the root mean square of (n,) with standard deviations `sd`, whatever the values without scatter.

    Scatter adds its own square to the mean square, which varies with the number of values and with the uncertainty of
    `sd`. Errors correlated with the values have the standard uncertainty `along_u` in the root mean square: by default
    that of n independent values.
    """
    n, square = len(values), float(np.mean(values**2)) - sd**2
    along = 2 * np.sqrt(max(square, 0.0)) * (sd / np.sqrt(n) if along_u is None else along_u)
    two_sided = scipy.special.ndtri((1 + CONFIDENCE) / 2)
    width = float(two_sided * np.hypot(along, np.hypot(np.sqrt(2 / n), 2 * SD_KNOWN) * sd**2))
    low, high = (float(np.sqrt(max(square + side * width, 0.0))) for side in (-1, 1))
    return Interval(low, high, sd)


def _denoised(values: Array, sd: float) -> Array:
    together = np.ones(min(NEIGHBOURS, len(values)))
    count = np.convolve(np.ones(len(values)), together, "same")
    means = np.convolve(values, together, "same") / count
    squares, left = float(np.mean(means**2)), float(np.mean(sd**2 / count))
    return np.asarray(means * np.sqrt(max(1 - left / squares, 0.0)) if squares else means)
