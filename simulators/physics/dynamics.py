"""Dynamic response of a sensor: a second-order low-pass filter and a pure delay, exact from latch to latch.

    H(s) = w² exp(-s delay) / (s² + 2 z w s + w²)

The filter is one complex mode: m' = p m + u with p = w (-z + i sqrt(1 - z²)), and the output is Im(g m). Over an
interval the mode decays, plus an integral of the input, computed by Gauss quadrature from a few points; for the motion
of a table within a millisecond its error is below 1e-7. The mean output needs no further integral, because m is known
at both ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Phasors = NDArray[np.complex128]

_POINTS, _WEIGHTS = (np.asarray(values) / 2 for values in np.polynomial.legendre.leggauss(4))
POINTS: Array = _POINTS + 0.5
"""Quadrature points of an interval, as fractions of it."""
SETTLED = (
    4.0  # limit of |p| times the interval: a longer one is many time constants of the sensor and averages its input
)
SAME_S = 1e-9  # intervals that differ by less count as equal
SPAN = 200.0  # range of logarithms of one cumulative sum, far from the limits of a float


@dataclass(frozen=True, slots=True)
class Dynamics:
    """A low-pass filter with its -3 dB frequency `bandwidth_hz`, a damping between 0 and 1, and a delay."""

    bandwidth_hz: float
    damping: float
    delay_s: float = 0.0

    @property
    def natural_hz(self) -> float:
        """Undamped natural frequency, w/2π."""
        bend = 1 - 2 * self.damping**2
        return self.bandwidth_hz / math.sqrt(bend + math.sqrt(1 + bend**2))

    @property
    def pole_per_s(self) -> complex:
        """Pole p of the mode."""
        return 2 * math.pi * self.natural_hz * complex(-self.damping, math.sqrt(1 - self.damping**2))

    def response(self, frequency_hz: Array) -> Phasors:
        """H at each frequency."""
        x = frequency_hz / self.natural_hz
        late = np.exp(-2j * np.pi * frequency_hz * self.delay_s)
        return np.asarray(late / (1 - x**2 + 2j * self.damping * x))


def look_at_s(edges_s: Array, delay_s: float = 0.0) -> Array:
    """Quadrature times (n, points) for the intervals between the edges (n + 1,)."""
    begin_s, interval_s = edges_s[:-1, np.newaxis], np.diff(edges_s)[:, np.newaxis]
    return np.asarray(begin_s + interval_s * POINTS - delay_s)


def mean_input(inputs: Array) -> Array:
    """Mean input over each interval, (n,), from its values at the points (n, points)."""
    return np.asarray(inputs @ _WEIGHTS)


class Follower:
    """Filter state of one sensor; starts settled at the first input."""

    def __init__(self, dynamics: Dynamics) -> None:
        self._pole = dynamics.pole_per_s
        self._gain = abs(self._pole) ** 2 / self._pole.imag
        self._mode: complex | None = None

    def mean(self, inputs: Array, interval_s: Array) -> Array:
        """Mean output over consecutive intervals (n,), for inputs at their points (n, points)."""
        mean = np.empty(len(interval_s))
        changes = np.flatnonzero(np.abs(np.diff(interval_s)) > SAME_S) + 1
        for rows in np.split(np.arange(len(interval_s)), changes):
            mean[rows] = self._alike(inputs[rows], float(interval_s[rows[0]]))
        return mean

    def _alike(self, inputs: Array, interval_s: float) -> Array:
        """The same for intervals of equal length."""
        if self._mode is None:
            self._mode = -complex(inputs[0, 0]) / self._pole
        step, averaged = self._pole * interval_s, mean_input(inputs)
        if abs(step) > SETTLED:
            self._mode = -complex(inputs[-1, -1]) / self._pole
            return averaged
        driven = inputs @ (interval_s * _WEIGHTS * np.exp(step * (1 - POINTS)))
        modes = np.concatenate(([self._mode], _decayed(driven, step, self._mode)))
        self._mode = complex(modes[-1])
        change = np.diff(modes) / interval_s
        return np.asarray(np.imag(self._gain * (change - averaged) / self._pole))


def _decayed(driven: Phasors, step: complex, mode: complex) -> Phasors:
    """Modes m[k] = exp(step) m[k-1] + driven[k], from the previous one."""
    modes = np.empty_like(driven)
    size = max(1, int(SPAN / -step.real))
    for first in range(0, len(driven), size):
        part = driven[first : first + size]
        decay = np.exp(step * np.arange(1, len(part) + 1))
        modes[first : first + size] = decay * (mode + np.cumsum(part / decay))
        mode = complex(modes[first + len(part) - 1])
    return modes
