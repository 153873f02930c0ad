"""Sequence numbers of frames, which wrap and rise by one: detection of lost, late and duplicated frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
MAX_LATE = 64  # numbers by which a frame may be behind the newest; one further back is from a restarted sender
CLOCK_SLACK = 0.5  # tolerance, relative to the usual interval between numbers


def shortest(steps: Integers, bits: int) -> Integers:
    """Difference of numbers that wrap; half their range or more counts as a step back."""
    half = 1 << (bits - 1)
    return ((steps + half) & (2 * half - 1)) - half


def unwrapped(raw: Integers, bits: int) -> Integers:
    """Unwrap numbers, counted from the first."""
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(shortest(np.diff(raw), bits))])


def unwrapped_by_clock(raw: Integers, bits: int, ticks: Integers, tick_bits: int) -> Integers:
    """Unwrap numbers that come with a clock, which resolves wraps during gaps.

    Valid up to half the range of the clock, forward over a gap and back to a late frame; a step inconsistent with the
    clock is taken as the shortest.
    """
    steps, clock = shortest(np.diff(raw), bits), shortest(np.diff(ticks), tick_bits)
    if not len(steps) or ((steps == 1).all() and 0 < clock.max() < 2 * clock.min()):
        return raw[:1] + np.arange(len(raw))  # the number cannot have wrapped between any two
    forward = (steps > 0) & (clock != 0)
    if not forward.any():
        return unwrapped(raw, bits)
    each = np.median((clock[forward] % (1 << tick_bits)) / steps[forward])
    expected = np.rint(clock / each).astype(np.int64)
    fits = (expected - steps) % (1 << bits) == 0
    return np.concatenate([raw[:1], raw[:1] + np.cumsum(np.where(fits, expected, steps))])


def ascending(numbers: Integers) -> NDArray[np.bool_]:
    """Mask of the numbers that exceed all before them."""
    fresh = np.ones(len(numbers), dtype=bool)
    if (numbers[1:] > numbers[:-1]).all():
        return fresh
    fresh[1:] = numbers[1:] > np.maximum.accumulate(numbers)[:-1]
    return fresh


def count_restarts(numbers: Integers, ticks: Integers, tick_bits: int) -> int:
    """Count restarts of a sender: jumps of its unwrapped numbers that disagree with its clock, or go back too far.

    After a loss of power a sender starts with other numbers, or at another clock time. A late or duplicated frame goes
    back as well, but in agreement with the clock and not far.
    """
    if (np.diff(numbers) == 1).all():
        return 0
    fresh = ascending(numbers)
    steps, clock = np.diff(numbers[fresh]), np.diff(ticks[fresh]) % (1 << tick_bits)
    each = float(np.median(clock[clock > 0] / steps[clock > 0])) if clock.any() else 0.0
    rounding = steps  # that interval is a whole number of ticks only on average
    jumps = (steps > 1) & (np.abs(clock - steps * each) >= CLOCK_SLACK * each + rounding)
    last = np.maximum.accumulate(np.where(fresh, np.arange(len(numbers)), 0))
    behind, anew = numbers[last] - numbers, ~fresh
    if clock.any():
        due = np.rint(behind * each).astype(np.int64)
        away = np.abs(shortest(ticks[last] - ticks - due, tick_bits)) >= CLOCK_SLACK * each
        anew &= (behind > MAX_LATE) | away
    else:
        anew, jumps = anew & (behind > MAX_LATE), np.zeros(0, dtype=bool)
    return int(np.count_nonzero(anew[1:] & ~anew[:-1]) + np.count_nonzero(jumps))


def gaps_in(numbers: Integers, first: int, last: int) -> Integers:
    """First and last number of each run between `first` and `last` that ascending `numbers` lack, (G, 2)."""
    if len(numbers) == last - first + 1:
        return np.empty((0, 2), np.int64)
    around = np.concatenate(([first - 1], numbers, [last + 1])).astype(np.int64)
    before = np.flatnonzero(np.diff(around) > 1)
    return np.stack([around[before] + 1, around[before + 1] - 1], axis=1)
