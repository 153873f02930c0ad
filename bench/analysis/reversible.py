"""Slope over temperature of what a unit does without its hysteresis.

A thermometer that is off by one error in a whole run shifts the temperatures of all dwells alike. Hysteresis follows
changes of temperature since the last reversals, not the temperature itself: the shift moves its loops along, and it is
at each dwell what it was. What the error of the thermometer does to a value thus follows from the slope of the rest.
A polynomial through rising and falling dwells bends with the loops.

Both are told apart by the reversals. Between two of them the loops of many units are parabolas (Lord Rayleigh, Phil.
Mag. 23, 225, 1887), which is what play operators come to whose thresholds are evenly spread, here up to half of what
the temperatures span. What the unit went through before the run is not known, and is forgotten at the first reversal as
far as a play has been taken up by then: dwells before it are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from bench.analysis.fit import Array, NotDetermined, PolynomialFit, least_squares

THRESHOLDS = 100
STANDS_C = 1.0  # a smaller change of temperature between two dwells is no reversal


def reversible_slope(at_c: Array, values: Array, model: PolynomialFit) -> Array:
    """Slope (n,) per °C at dwells (n,) in the order of time, hysteresis left out.

    It is that of the model where the dwells since the first reversal, the one there included, are not more than the
    coefficients of the model and of the hysteresis, or do not determine these.
    """
    since = slice(_first_reversal(at_c), None)
    z = (at_c - model.centre) / model.scale
    powers = polynomial.polyvander(z, model.degree)
    design = np.column_stack([powers, hysteresis_of(at_c)])[since]
    if len(design) <= design.shape[1]:
        return model.slope(at_c)
    try:
        fit = least_squares(design, values[since])
    except NotDetermined:
        return model.slope(at_c)
    return np.asarray(polynomial.polyval(z, polynomial.polyder(fit.coefficients[:-1])) / model.scale)


def hysteresis_of(at_c: Array) -> Array:
    """Hysteresis (n,) in °C of plays with evenly spread thresholds, after temperatures (n,) in turn; 0 at the first."""
    half_c = float(np.ptp(at_c)) / 2
    threshold_c = half_c * (np.arange(THRESHOLDS) + 0.5) / THRESHOLDS
    behind_c, found = np.full(THRESHOLDS, at_c[0]), np.empty(len(at_c))
    for number, now_c in enumerate(at_c):
        behind_c = np.clip(behind_c, now_c - threshold_c, now_c + threshold_c)
        found[number] = np.mean(now_c - behind_c)
    return found


def _first_reversal(at_c: Array) -> int:
    """The number of the dwell at which the temperatures first turn; their count where they do not."""
    change_c = np.diff(at_c)
    moves = np.flatnonzero(np.abs(change_c) > STANDS_C)
    turns = moves[1:][np.diff(np.sign(change_c[moves])) != 0]
    return int(turns[0]) if len(turns) else len(at_c)
