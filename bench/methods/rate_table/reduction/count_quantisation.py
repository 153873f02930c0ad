"""Effect of count quantisation on a sine fitted to counts (equations 5.3, 8.5).

A count is the rounded charge: its error is a sawtooth of the charge, Σ sin(2π m n) / (π m). For an oscillation of many
pulses that is a chirp of hundreds of lines, at j times the frequency f of the oscillation plus m times the mean rate of
b pulses per second. Sampled at a rate r, those lines alias to the frequency of the oscillation for which j f + m b is
near a whole multiple of r: there the error is a constant sine, invisible in the residuals, and may be many times the
surrounding lines. Its position depends on a bias that is unknown beforehand. Therefore the counting errors are computed
latch by latch for the fitted charge; unknown is the fraction of a pulse at the beginning.
"""

from __future__ import annotations

import numpy as np

from bench.metrology.least_squares import Array

REMAINDERS = 15  # number of initial fractions of a pulse
A_FEW = slice(1, None, 3)  # equidistant initial fractions, the same for a unit of the other sign
LATCHES = 200  # minimum number over which counting errors average out


def errors_of_counting(charge: Array) -> Array:
    """Counting errors at latches for a charge (n,) in pulses, (REMAINDERS, n), one row for each initial fraction.

    For a counter with play, the charge is the one that lags by the play.
    """
    with_remainder = charge + (np.arange(REMAINDERS)[:, np.newaxis] + 0.5) / REMAINDERS
    return np.asarray(np.round(with_remainder) - with_remainder)


def slowly(residuals: Array, time_s: Array, period_s: float) -> Array:
    """Means of residuals (n,) over whole periods about each: slow changes in them are charge, such as integrated noise.

    A pulse of it is enough to shift or to spread the lines.
    """
    latch_s = float(np.median(np.diff(time_s)))
    periods = np.ceil(LATCHES * latch_s / period_s)
    half = round(periods * period_s / latch_s / 2)
    at, so_far = np.arange(len(residuals)), np.append(0.0, np.cumsum(residuals))
    first, last = np.maximum(at - half, 0), np.minimum(at + half + 1, len(residuals))
    return np.asarray((so_far[last] - so_far[first]) / (last - first))


def along_and_across(phasors: Array, moved: Array) -> tuple[Array, Array]:
    """RMS changes of phasors (m, 2), cosine and sine, by `moved` (k, m, 2): along each, and across it, (m,)."""
    size = np.linalg.norm(phasors, axis=1, keepdims=True)
    along = np.divide(phasors, size, out=np.tile([1.0, 0.0], (len(phasors), 1)), where=size > 0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    by_along, by_across = (np.sqrt(np.mean(np.sum(moved * each, axis=2) ** 2, axis=0)) for each in (along, across))
    return by_along, by_across
