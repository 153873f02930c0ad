"""Slope over temperature of what a unit does without its hysteresis.

A thermometer that is off by the same in a whole run shifts the temperatures of all dwells alike. Hysteresis follows
changes of temperature since the last reversals, not the temperature itself: the shift moves its loops along, and at
each dwell it is what it was. What the error of the thermometer does to a value follows from the slope of all else.
A polynomial through rising and falling dwells bends with the loops, most at its ends.

Both are told apart by the dwells after a reversal. Hysteresis is that of play operators with thresholds evenly spread
up to a largest one, between two reversals a parabola (Lord Rayleigh, Phil. Mag. 23, 225, 1887) that ends where the
largest play is taken up. The largest threshold is not known: the slopes with each are averaged, weighted by their
likelihood. What the unit went through before the run is not known either, and is forgotten at a reversal as far as
plays have been taken up by then: dwells before the first reversal are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, least_squares

LARGEST = 12  # largest thresholds that are tried, up to half of what the temperatures span
THRESHOLDS = 100  # up to each of them
ROUNDING = 16 * np.finfo(np.float64).eps  # of the largest value
STANDS_C = 1.0  # a smaller change of temperature between two dwells is no reversal


def reversible_slope(at_c: Array, values: Array, u: float, model: PolynomialFit) -> Array:
    """Slope (n,) per °C at dwells (n,) in the order of time, hysteresis left out.

    `u` is what one value scatters by. The slope is that of the model where the dwells from the first reversal on are
    not more than the coefficients of the model and of the hysteresis, or do not determine these.
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
        # Of residuals with an unknown standard deviation, which is not less than the scatter.
        log_likelihoods.append(-dwells / 2 * np.log(dwells * least_u**2 + float(np.sum(fit.residuals**2))))
    weights = np.exp(np.array(log_likelihoods) - max(log_likelihoods))
    bend = weights @ np.array(bends) / weights.sum()
    return np.asarray(polynomial.polyval((at_c - model.centre) / model.scale, bend) / model.scale)


def hysteresis_c(at_c: Array, largest_c: float) -> Array:
    """By how much plays with thresholds up to the largest are behind temperatures (n,) on average, 0 at the first."""
    threshold_c = largest_c * (np.arange(THRESHOLDS) + 0.5) / THRESHOLDS
    follows_c, found_c = np.full(THRESHOLDS, at_c[0]), np.empty(len(at_c))
    for number, now_c in enumerate(at_c):
        follows_c = np.clip(follows_c, now_c - threshold_c, now_c + threshold_c)
        found_c[number] = np.mean(now_c - follows_c)
    return found_c


def _first_reversal(at_c: Array) -> int:
    """The number of the dwell at which the temperatures first turn; their count where they do not."""
    change_c = np.diff(at_c)
    moves = np.flatnonzero(np.abs(change_c) > STANDS_C)
    turns = moves[1:][np.diff(np.sign(change_c[moves])) != 0]
    return int(turns[0]) if len(turns) else len(at_c)
