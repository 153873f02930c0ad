"""Slope of a unit's quantity over temperature, without hysteresis.

A constant error of a thermometer in a run shifts the temperatures of all dwells alike. Hysteresis depends on changes of
temperature since the last reversals, not on the temperature itself: its loops shift with it, and at each dwell it is
unchanged. The effect of the thermometer error on a value therefore follows from the slope without hysteresis. A
polynomial through rising and falling dwells bends with the loops, most at its ends.

The dwells after a reversal separate the two. Hysteresis is modelled by play operators with thresholds evenly
distributed up to a largest one: between two reversals a parabola (Lord Rayleigh, Phil. Mag. 23, 225, 1887) that ends
where the largest play is taken up. The largest threshold is unknown: the slopes for each are averaged, weighted by
their likelihood. The history of the unit before the run is unknown too, and is erased at a reversal as far as plays
have been taken up by then: dwells before the first reversal are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, least_squares

LARGEST = 12  # number of largest thresholds tried, up to half the temperature range
THRESHOLDS = 100  # number of thresholds up to each of them
ROUNDING = 16 * np.finfo(np.float64).eps  # relative to the largest value
STANDS_C = 1.0  # a smaller temperature change between two dwells is not a reversal


def reversible_slope(at_c: Array, values: Array, u: float, model: PolynomialFit) -> Array:
    """Slope (n,) per °C at dwells (n,) in time order, without hysteresis.

    `u` is the standard deviation of one value. The slope is that of the model if the dwells from the first reversal on
    are not more than the coefficients of model and hysteresis, or do not determine these.
    """
    since = slice(_first_reversal(at_c), None)
    powers = polynomial.polyvander((at_c - model.centre) / model.scale, model.degree)
    dwells = len(at_c[since])
    if dwells <= powers.shape[1] + 1:
        return model.slope(at_c)
    bends, log_likelihoods = [], []
    least_u = max(u, ROUNDING * float(np.max(np.abs(values))), np.finfo(np.float64).tiny ** 0.5)
    for largest_c in float(np.ptp(at_c)) / 2 * np.arange(1, LARGEST + 1) / LARGEST:
        design = np.column_stack([powers, hysteresis_c(at_c, largest_c)])[since]
        try:
            fit = least_squares(design, values[since])
        except NotDetermined:
            return model.slope(at_c)
        bends.append(polynomial.polyder(fit.coefficients[:-1]))
        # Likelihood of residuals with unknown standard deviation, at least the scatter.
        log_likelihoods.append(-dwells / 2 * np.log(dwells * least_u**2 + float(np.sum(fit.residuals**2))))
    weights = np.exp(np.array(log_likelihoods) - max(log_likelihoods))
    bend = weights @ np.array(bends) / weights.sum()
    return np.asarray(polynomial.polyval((at_c - model.centre) / model.scale, bend) / model.scale)


def hysteresis_c(at_c: Array, largest_c: float) -> Array:
    """Mean lag of plays with thresholds up to the largest behind temperatures (n,), 0 at the first."""
    threshold_c = largest_c * (np.arange(THRESHOLDS) + 0.5) / THRESHOLDS
    follows_c, found_c = np.full(THRESHOLDS, at_c[0]), np.empty(len(at_c))
    for number, now_c in enumerate(at_c):
        follows_c = np.clip(follows_c, now_c - threshold_c, now_c + threshold_c)
        found_c[number] = np.mean(now_c - follows_c)
    return found_c


def _first_reversal(at_c: Array) -> int:
    """Index of the dwell at which the temperatures first reverse; the number of dwells if they do not."""
    change_c = np.diff(at_c)
    moves = np.flatnonzero(np.abs(change_c) > STANDS_C)
    turns = moves[1:][np.diff(np.sign(change_c[moves])) != 0]
    return int(turns[0]) if len(turns) else len(at_c)
