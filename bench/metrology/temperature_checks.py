"""Implausible readings of thermometers: an open sensor, a jump (equations 1.10)."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]
POSSIBLE_C = (-100.0, 200.0)  # wider than any chamber; an open or shorted sensor reads far beyond
JUMP_C = 5.0


def broken_at_rest(temperature_c: Array) -> NDArray[np.bool_]:
    """Mask of readings (n,) of one soaked dwell, in any order, that are impossible or far from the median of all."""
    impossible = beyond_possible(temperature_c)
    if impossible.all():
        return impossible
    return impossible | (np.abs(temperature_c - np.median(temperature_c[~impossible])) > JUMP_C)


def broken_on_a_ramp(time_s: Array, temperature_c: Array) -> NDArray[np.bool_]:
    """Mask of readings (n,), in time order, that are impossible or do not belong to the temperature curve.

    Jumps divide the readings into stretches. The curve is the chain of stretches with the most readings in which each
    begins where the one before it ended, within a jump and the usual change meanwhile.
    """
    broken = beyond_possible(temperature_c)
    possible = np.flatnonzero(~broken)
    at_s, course_c = time_s[possible], temperature_c[possible]
    steps_s, steps_c = np.diff(at_s), np.abs(np.diff(course_c))
    if not len(steps_c):
        return broken
    usual = steps_c <= JUMP_C
    usual_c_per_s = float(np.median((steps_c / steps_s)[usual if usual.any() else ~usual]))
    jumps = np.flatnonzero(steps_c > JUMP_C + usual_c_per_s * steps_s) + 1
    begin, end = np.append(0, jumps), np.append(jumps, len(course_c))
    readings, before = (end - begin).astype(np.float64), np.full(len(begin), -1)
    for k in range(1, len(begin)):
        gap_s, gap_c = at_s[begin[k]] - at_s[end[:k] - 1], course_c[begin[k]] - course_c[end[:k] - 1]
        follows = np.flatnonzero(np.abs(gap_c) <= JUMP_C + usual_c_per_s * gap_s)
        if len(follows):
            before[k] = follows[np.argmax(readings[follows])]
            readings[k] += readings[before[k]]
    broken[possible] = True
    k = int(np.argmax(readings))
    while k >= 0:
        broken[possible[begin[k] : end[k]]] = False
        k = int(before[k])
    return broken


def beyond_possible(temperature_c: Array) -> NDArray[np.bool_]:
    """Mask of readings (n,) beyond the range of any chamber; NaN is not among them."""
    return (temperature_c < POSSIBLE_C[0]) | (temperature_c > POSSIBLE_C[1])


def usable(temperature_c: Array) -> NDArray[np.bool_]:
    """Mask of readings (n,) that are there and possible."""
    return np.isfinite(temperature_c) & ~beyond_possible(temperature_c)


def rates_c_per_s(time_s: Array, temperature_c: Array, samples: int, every: int = 1) -> Array:
    """Slopes of lines through consecutive `samples` of (n,): (n - samples + 1,), or every `every`-th."""
    time_s, temperature_c = (sliding_window_view(column, samples)[::every] for column in (time_s, temperature_c))
    time_s = time_s - time_s.mean(axis=-1, keepdims=True)
    return np.asarray(np.sum(time_s * temperature_c, axis=-1) / np.sum(time_s**2, axis=-1))
