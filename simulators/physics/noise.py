"""Noise of sensors: white noise, and slow bias drift (equations 8.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]
INSTABILITY_S = 10.0  # correlation time of the bias drift
WANDER_STEP_S = 1.0  # step of its draws, independent of the length of a block


class Wander:
    """A first-order Gauss-Markov process, drawn at least every second, with linear interpolation."""

    def __init__(self, sd: float, draws: Generator) -> None:
        self._sd, self._draws = sd, draws
        self._value = sd * float(draws.standard_normal())

    def passed(self, step_s: float, steps: int) -> list[float]:
        """Present value, and values after each of a number of steps."""
        keep = math.exp(-step_s / INSTABILITY_S)
        spread, value = math.sqrt(1 - keep * keep) * self._sd, self._value
        drawn = self._draws.standard_normal(steps).tolist()
        found = [value, *[value := keep * value + spread * fresh for fresh in drawn]]
        self._value = value
        return found


def at_ends(wanders: Sequence[Wander], interval_s: Array) -> Array:
    """Values at the end of each of consecutive intervals of about equal length, (c, n)."""
    over_s = float(interval_s.sum())
    steps = math.ceil(over_s / WANDER_STEP_S)
    drawn = np.array([wander.passed(over_s / steps, steps) for wander in wanders])
    ends, part = _even(len(interval_s), steps)
    found: Array = (drawn[:, 1:] - drawn[:, :-1]).repeat(ends, axis=1)
    found *= part
    found += drawn[:, :-1].repeat(ends, axis=1)
    return found


@lru_cache(maxsize=16)
def _even(intervals: int, steps: int) -> tuple[NDArray[np.intp], Array]:
    """Number of intervals that end in each of the equal steps, and the fraction of a step at which each ends."""
    passed = np.arange(1, intervals + 1) * (steps / intervals)
    step = np.minimum(passed.astype(np.intp), steps - 1)
    return np.bincount(step, minlength=steps), np.asarray(passed - step, np.float64)


class Noise:
    """White noise and slow bias drift, each from its own stream; a mean over 1 s has the white noise `white_1s`."""

    def __init__(self, white_1s: float, wander: float, streams: tuple[Generator, Generator]) -> None:
        self.white_1s, self.white = white_1s, streams[0]
        self.wander = Wander(wander, streams[1])

    def mean(self, interval_s: Array) -> Array:
        """Mean noise over each of the consecutive intervals."""
        return np.asarray(mean_noise([self], interval_s)[0])

    def pass_over(self, passed_s: float) -> None:
        """Advance the time without a reading; the bias drifts meanwhile."""
        self.wander.passed(passed_s, 1)


def mean_noise(channels: Sequence[Noise], interval_s: Array) -> Array:
    """Mean noise of several channels over each of the consecutive intervals, (c, n)."""
    found = at_ends([channel.wander for channel in channels], interval_s)
    white, root_s = np.empty(len(interval_s)), np.sqrt(interval_s)
    for row, channel in zip(found, channels, strict=True):
        channel.white.standard_normal(out=white)
        white *= channel.white_1s / root_s
        row += white
    return found
