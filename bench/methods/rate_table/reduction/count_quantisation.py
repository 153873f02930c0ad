"""What the steps of a counter do to a sine that is fitted to its counts (equations 5.3, 8.5).

A count is its charge rounded: what is off is a saw tooth of the charge, Σ sin(2π m n) / (π m). On a swing of many
pulses that is a chirp of hundreds of lines, j times the frequency f of the swing and m times the b pulses a second that
it goes on by. Latched at a rate r, those fall onto the line of the swing for which j f + m b is near a whole number of
r: there the error is the same sine all the time, and nothing in the residuals shows it. It may be many times what is
around. Where it falls depends on a bias that nobody knows beforehand. So what a counter would be off is worked out
latch by latch for the charge that was found; unknown is the part of a pulse that was left over when it began.
"""

from __future__ import annotations

import numpy as np

from bench.metrology.least_squares import Array

REMAINDERS = 15  # parts of a pulse that may be left over
A_FEW = slice(1, None, 3)  # of them, as far apart as each other, and the same ones for a unit of the other sign
LATCHES = 200  # over which errors of counting average out, at least


def errors_of_counting(charge: Array) -> Array:
    """By how much counts at latches differ from a charge (n,) in pulses, (REMAINDERS, n), one with each remainder.

    Of a counter with play, its charge is to be that which stands behind by the play.
    """
    with_remainder = charge + (np.arange(REMAINDERS)[:, np.newaxis] + 0.5) / REMAINDERS
    return np.asarray(np.round(with_remainder) - with_remainder)


def slowly(residuals: Array, time_s: Array, period_s: float) -> Array:
    """Means of residuals (n,) over whole periods about each: what goes slowly in them is charge, as of noise summed up.

    A pulse of it is enough to take the lines elsewhere, or to spread them.
    """
    latch_s = float(np.median(np.diff(time_s)))
    periods = np.ceil(LATCHES * latch_s / period_s)
    half = round(periods * period_s / latch_s / 2)
    at, so_far = np.arange(len(residuals)), np.append(0.0, np.cumsum(residuals))
    first, last = np.maximum(at - half, 0), np.minimum(at + half + 1, len(residuals))
    return np.asarray((so_far[last] - so_far[first]) / (last - first))


def along_and_across(phasors: Array, moved: Array) -> tuple[Array, Array]:
    """Rms of what moves phasors (m, 2), cosine and sine, by `moved` (k, m, 2): along each, and across it, (m,)."""
    size = np.linalg.norm(phasors, axis=1, keepdims=True)
    along = np.divide(phasors, size, out=np.tile([1.0, 0.0], (len(phasors), 1)), where=size > 0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    by_along, by_across = (np.sqrt(np.mean(np.sum(moved * each, axis=2) ** 2, axis=0)) for each in (along, across))
    return by_along, by_across
