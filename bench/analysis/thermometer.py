"""What a working thermometer cannot say: an open sensor, a jump (methods.md 1.10)."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench.analysis.fit import Array

POSSIBLE_C = (-100.0, 200.0)  # wider than any chamber; an open or shorted sensor reads far beyond
JUMP_C = 5.0


def broken_at_rest(temperature_c: Array) -> NDArray[np.bool_]:
    """Which readings (n,) of one soaked dwell, in any order, are impossible or far from the median of all."""
    impossible = beyond_possible(temperature_c)
    if impossible.all():
        return impossible
    return impossible | (np.abs(temperature_c - np.median(temperature_c[~impossible])) > JUMP_C)


def broken_on_a_ramp(temperature_c: Array) -> NDArray[np.bool_]:
    """Which readings (n,), in the order of time, are impossible or far from the median of five neighbours.

    The median follows a ramp, and passes over up to two bad samples in a row.
    """
    impossible = beyond_possible(temperature_c)
    if impossible.all():
        return impossible
    possible_c = temperature_c[~impossible]
    neighbours = sliding_window_view(np.pad(possible_c, 2, constant_values=np.nan), 5)
    broken = impossible.copy()
    broken[~impossible] = np.abs(possible_c - np.nanmedian(neighbours, axis=-1)) > JUMP_C
    return broken


def beyond_possible(temperature_c: Array) -> NDArray[np.bool_]:
    """Which readings (n,) are beyond anything that a chamber reaches; NaN is not among them."""
    return (temperature_c < POSSIBLE_C[0]) | (temperature_c > POSSIBLE_C[1])


def rates_c_per_s(time_s: Array, temperature_c: Array, samples: int) -> Array:
    """The slopes of lines through each so many consecutive samples of (n,), (n - samples + 1,)."""
    time_s, temperature_c = (sliding_window_view(column, samples) for column in (time_s, temperature_c))
    time_s = time_s - time_s.mean(axis=-1, keepdims=True)
    return np.asarray(np.sum(time_s * temperature_c, axis=-1) / np.sum(time_s**2, axis=-1))
