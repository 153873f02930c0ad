"""Numbers that frames carry so that lost, late and doubled ones are seen: they wrap, and rise by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


def shortest(steps: Integers, bits: int) -> Integers:
    """Steps of a number that wraps; half its range or more is a step back."""
    half = 1 << (bits - 1)
    return (steps + half) % (2 * half) - half


def unwrapped(raw: Integers, bits: int) -> Integers:
    """Numbers that wrap as numbers that do not, counted from the first."""
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(shortest(np.diff(raw), bits))])


def ascending(numbers: Integers) -> NDArray[np.bool_]:
    """Which of the numbers are above all before them."""
    fresh = np.ones(len(numbers), dtype=bool)
    fresh[1:] = numbers[1:] > np.maximum.accumulate(numbers)[:-1]
    return fresh
