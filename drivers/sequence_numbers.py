"""Numbers that frames carry so that lost, late and doubled ones are seen: they wrap, and rise by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


def shortest(steps: Integers, bits: int) -> Integers:
    """Steps of a number that wraps; half its range or more is a step back."""
    half = 1 << (bits - 1)
    return ((steps + half) & (2 * half - 1)) - half


def unwrapped(raw: Integers, bits: int) -> Integers:
    """Numbers that wrap as numbers that do not, counted from the first."""
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(shortest(np.diff(raw), bits))])


def unwrapped_by_clock(raw: Integers, bits: int, ticks: Integers, tick_bits: int) -> Integers:
    """The same of numbers that come with a clock, which tells of a gap how often the number has gone round in it.

    Up to half the range of the clock; what goes back by its number, and does not fit the clock, stays a step back.
    """
    steps, clock = shortest(np.diff(raw), bits), np.diff(ticks) % (1 << tick_bits)
    forward = steps > 0
    if not forward.any():
        return unwrapped(raw, bits)
    told = np.rint(clock / np.median(clock[forward] / steps[forward])).astype(np.int64)
    fits = ((told - steps) % (1 << bits) == 0) & (told > 0) & (clock < 1 << (tick_bits - 1))
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(np.where(fits, told, steps))])


def ascending(numbers: Integers) -> NDArray[np.bool_]:
    """Which of the numbers are above all before them."""
    fresh = np.ones(len(numbers), dtype=bool)
    fresh[1:] = numbers[1:] > np.maximum.accumulate(numbers)[:-1]
    return fresh
