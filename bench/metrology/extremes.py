"""How well a largest value is known: the scatter of the values moves it, and it is larger than it would be without.

Of many values that scatter the largest is one that the scatter has made larger. How much is found by trial (a Monte
Carlo after JCGM 101): what the values would be without scatter is estimated, then they are let scatter anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import erf, ndtri

from bench.metrology.least_squares import SIGMA_PER_MAD, Array
from bench.metrology.results.finding import CONFIDENCE, Interval

TRIALS = 200
NEIGHBOURS = 15  # whose mean stands for a value without scatter
SECOND_DIFFERENCE_SD = np.sqrt(6.0)  # of 1, -2, 1 times values with a standard deviation of 1
FAR_SIGMAS = 3.0  # from there on it is a jump, or a corner
GRID_SIGMAS = 8.0  # up to where the distribution of a largest error is worked out: of 1e9 errors none is larger
GRID_POINTS = 2000
SD_KNOWN = 0.05  # relative standard uncertainty of a standard deviation from second differences
FEWEST = 5  # second differences whose median tells something


def scatter_sd(records: Sequence[Array], stride: int = 1, gains: Sequence[Array] | None = None) -> float:
    """The standard deviation of what is not smooth in records of evenly taken values, each (n,); NaN where too short.

    From their second differences over `stride` values, without those far beyond the median, so that a few jumps do not
    count. A stride of 2 passes over what neighbours share, such as a count that one has more and the next has less.
    Values may scatter by the result times their `gains` (n,) each.
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
    usual = SIGMA_PER_MAD * float(np.median(differences))  # of counts it may be no better than one count
    calm = differences[differences <= FAR_SIGMAS * usual] if usual else differences
    return float(np.sqrt(np.mean(calm**2)) / SECOND_DIFFERENCE_SD)


def largest_u(values: Array, sd: float) -> tuple[float, float]:
    """Standard uncertainties of the largest |value| of (n,) that scatter by `sd`: by scatter, by being the largest.

    The values without scatter are taken for the means of neighbours, made smaller all alike by what scatter is left in
    them: nothing where all is scatter, hardly changed where there is none. Equal values give equal results.
    """
    calm = _calm(values, sd)
    draws = np.random.default_rng(0).standard_normal((TRIALS, len(values)))
    found = np.max(np.abs(calm + sd * draws), axis=-1)
    return float(np.std(found, ddof=1)), float(np.mean(found) - np.max(np.abs(calm)))


def span_u(values: Array, sd: float) -> tuple[float, float]:
    """The same of the span of (n,), the largest value less the smallest."""
    calm = _calm(values - np.mean(values), sd)
    draws = np.random.default_rng(0).standard_normal((TRIALS, len(values)))
    found = np.ptp(calm + sd * draws, axis=-1)
    return float(np.std(found, ddof=1)), float(np.mean(found) - np.ptp(calm))


def interval_of_largest(values: Array, sd: Array | float) -> Interval:
    """The range of the largest |value| of (n,) that scatter by `sd`, one or (n,), whatever they are without scatter.

    It cannot exceed every |value| by more than the scatter of that one, nor can it be less than the largest by more
    than the largest scatter of all. Either is so at 97.5 %, which does not depend on whether they scatter independently
    but for the second: where they do not it is so all the more.
    """
    sds = np.broadcast_to(np.asarray(sd, np.float64), values.shape)
    one_sided = (1 + CONFIDENCE) / 2
    high = float(np.max(np.abs(values) + ndtri(one_sided) * sds))
    expected, most = _largest_scatter(tuple(sds.tolist()), one_sided)
    return Interval(max(float(np.max(np.abs(values))) - most, 0.0), high, expected)


@lru_cache(maxsize=64)  # a fine grid each time, and repeated trials ask for the same
def _largest_scatter(sd: tuple[float, ...], probability: float) -> tuple[float, float]:
    """Of the largest |error| of independent normal errors: its mean, and what it stays below with a probability."""
    widths, counts = np.unique(sd, return_counts=True)
    largest = float(widths[-1])
    if not largest:
        return 0.0, 0.0
    limit = np.linspace(0, GRID_SIGMAS * largest, GRID_POINTS)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = np.where(widths > 0, erf(limit[:, np.newaxis] / (widths * np.sqrt(2))), 1.0)
    below = np.prod(inside**counts, axis=1)
    return float(np.trapezoid(1 - below, limit)), float(np.interp(probability, below, limit))


def interval_of_span(values: Array, sd: float) -> Interval:
    """The range of the span of (n,) that scatter by `sd`, whatever they are without scatter.

    Any two differ by no more than they do here and their scatter; the span cannot be less than this one by more than
    that of as many errors. Either is so at 97.5 %.
    """
    spans = np.ptp(sd * np.random.default_rng(0).standard_normal((TRIALS, len(values))), axis=-1)
    one_sided, span = (1 + CONFIDENCE) / 2, float(np.ptp(values))
    low = max(span - float(np.quantile(spans, one_sided)), 0.0)
    return Interval(low, span + float(ndtri(one_sided) * np.sqrt(2) * sd), float(np.mean(spans)))


def interval_of_rms(values: Array, sd: float, along_u: float | None = None) -> Interval:
    """The range of the root mean square of (n,) that scatter by `sd`, whatever they are without scatter.

    Scatter adds its own square to the mean square, which varies by as much as n values tell and as `sd` is known. What
    goes along with the values has the standard uncertainty `along_u` in the root mean square: that of n values that
    scatter independently, unless another is known.
    """
    n, square = len(values), float(np.mean(values**2)) - sd**2
    along = 2 * np.sqrt(max(square, 0.0)) * (sd / np.sqrt(n) if along_u is None else along_u)
    width = float(ndtri((1 + CONFIDENCE) / 2) * np.hypot(along, np.hypot(np.sqrt(2 / n), 2 * SD_KNOWN) * sd**2))
    low, high = (float(np.sqrt(max(square + side * width, 0.0))) for side in (-1, 1))
    return Interval(low, high, sd)


def _calm(values: Array, sd: float) -> Array:
    together = np.ones(min(NEIGHBOURS, len(values)))
    count = np.convolve(np.ones(len(values)), together, "same")
    means = np.convolve(values, together, "same") / count
    squares, left = float(np.mean(means**2)), float(np.mean(sd**2 / count))
    return np.asarray(means * np.sqrt(max(1 - left / squares, 0.0)) if squares else means)
