"""Turn-rounds of the legs of a temperature ramp: a unit continues to cool after the air has begun to warm."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench.metrology.least_squares import Array
from bench.metrology.temperature_checks import broken_on_a_ramp

WINDOW = 5  # samples; no single one affects their median
LEAST = 2 * WINDOW  # minimum number of samples of a stretch in which a turn can be detected


def stretches(time_s: Array, longest_hole: int) -> Iterator[slice]:
    """Parts of samples (n,) in time order without a gap longer than `longest_hole` sample intervals."""
    interval_s = np.diff(time_s)
    limit_s = longest_hole * float(np.median(interval_s)) if len(interval_s) else 0.0
    holes = np.flatnonzero(interval_s > limit_s) + 1
    return (slice(start, end) for start, end in pairwise([0, *holes.tolist(), len(time_s)]))


def on_its_way(time_s: Array, temperature_c: Array, *, falls: bool) -> NDArray[np.bool_]:
    """Mask of samples (n,) of a leg, in time order, that belong to its single branch over temperature.

    A stretch begins where the temperature has returned to the median of its first `WINDOW` samples, and ends before it
    first reaches that of its last; each is within its half, so that a leg that consists of turns retains the half after
    its own. At the temperatures of the turn-rounds, which are left out, there are two branches. A stretch of few
    samples, or one without a turn, is whole; one in the other direction is left out. Readings of a broken thermometer,
    and missing samples, are ignored.
    """
    along_c = -temperature_c if falls else temperature_c
    kept = np.zeros(len(time_s), dtype=np.bool_)
    for part in stretches(time_s, WINDOW):
        known = part.start + np.flatnonzero(np.isfinite(along_c[part]))
        known = known[~broken_on_a_ramp(time_s[known], temperature_c[known])]
        begin, end = _branch(along_c[known]) if len(known) >= LEAST else (0, len(known))
        kept[part.start if begin == 0 else known[begin] : part.stop if end == len(known) else known[end]] = True
    return kept


def _branch(along_c: Array) -> tuple[int, int]:
    """First and last index of the rising branch of (n,), equal if there is none; it contains turns of few samples."""
    n, away = len(along_c), WINDOW // 2
    medians_c = np.median(sliding_window_view(along_c, WINDOW), axis=1)
    lowest, highest = int(np.argmin(medians_c)), int(np.argmax(medians_c))
    if medians_c[lowest] == medians_c[highest]:
        return 0, n
    rising_c = medians_c[lowest : highest + 1]
    back, there = np.flatnonzero(rising_c <= medians_c[0]), np.flatnonzero(rising_c >= medians_c[-1])
    if not len(back) or not len(there) or back[-1] >= there[0]:
        return 1, 1
    begin = min(lowest + int(back[-1]) + away + 1, max(lowest + away, n // 2))
    end = max(lowest + int(there[0]) + away, min(highest + away, n // 2))
    return begin if begin > WINDOW else 0, end if end < n - WINDOW else n
