"""Time history of zero and scale of a compensated channel after power-on, and their settling times.

Readings v at times t since power-on, each at a known input d, are fitted by

    v = zero(t) + d · scale(t),   zero and scale each a constant and terms exp(-t / τ) with given time constants τ

so that a change between readings at different inputs is in neither. Time constants a factor of three apart represent
all time constants between them, within some percent of the change at power-on; only the sum of the terms has a meaning.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtri

from bench.metrology.least_squares import Array, LinearFit, least_squares
from bench.metrology.results.finding import CONFIDENCE, Interval

Part = Literal["zero", "scale"]
GRID_S = 1.0  # spacing of the time grid
DRAWS = 40  # errors of a time history that are drawn
CONDITION_LIMIT = 1e6  # poorly separated terms do no harm, because only their sum is used


@dataclass(frozen=True, slots=True)
class Courses:
    """Fit of the readings of one channel; `at_s` (n,) are their times since power-on, `drive` (n,) their inputs."""

    at_s: Array
    drive: Array
    time_constants_s: tuple[float, ...]
    fit: LinearFit

    @property
    def grid_s(self) -> Array:
        """Time grid from power-on to the last reading."""
        return np.append(np.arange(0.0, float(self.at_s.max()), GRID_S), float(self.at_s.max()))

    def of(self, part: Part, at_s: Array) -> Array:
        """One time history, zero or scale, at times (m,)."""
        return self._terms(at_s) @ self._rows(part, self.fit.coefficients)

    def weights(self, part: Part, at_s: Array) -> Array:
        """Sensitivity of a time history at times (m,) to each reading: (m, n)."""
        return np.asarray(self._terms(at_s) @ self._rows(part, self.fit.gain))

    def points(self, part: Part) -> Array:
        """Each reading as a value of one time history, the other one taken as fitted, (n,)."""
        own = self.of(part, self.at_s)
        return np.asarray(own + self.fit.residuals / (self.drive if part == "scale" else 1.0))

    def _terms(self, at_s: Array) -> Array:
        return _terms(at_s, self.time_constants_s)

    def _rows(self, part: Part, values: Array) -> Array:
        count = 1 + len(self.time_constants_s)
        return values[:count] if part == "zero" else values[count:]


def fit_courses(at_s: Array, values: Array, drive: Array, time_constants_s: Sequence[float]) -> Courses:
    """Fit readings (n,); raises NotDetermined if they are too few, over too short a time, or all at one input."""
    terms = _terms(at_s, time_constants_s)
    design = np.hstack([terms, terms * drive[:, np.newaxis]])
    fit = least_squares(design, values, condition_limit=CONDITION_LIMIT)
    return Courses(at_s, drive, tuple(time_constants_s), fit)


def _terms(at_s: Array, time_constants_s: Sequence[float]) -> Array:
    return np.stack([np.ones_like(at_s), *(np.exp(-at_s / tau_s) for tau_s in time_constants_s)], axis=-1)


@dataclass(frozen=True, slots=True)
class Settling:
    """Time since power-on (s) after which a quantity stays within its limit.

    `u_s` is its root-mean-square change under errors of the time history with its standard uncertainties. The settling
    time is not a linear function of the time history, least of all of a flat one, so that it has a range too.
    `to_the_end` is true if the quantity is outside at the end: settling takes longer than the readings;
    `perhaps_to_the_end` if it may be, so that the range ends with the readings; `from_the_start` if it never is
    outside.
    """

    at_s: float
    u_s: float
    interval_s: Interval
    to_the_end: bool
    perhaps_to_the_end: bool
    from_the_start: bool


def settling(grid_s: Array, off: Array, u: Array, limit: float) -> Settling:
    """Settling time of a quantity with the error `off` and its standard uncertainties `u`; all (m,).

    The distribution is propagated (JCGM 101) with errors of one common multiple of `u`. The range extends from the
    settling time of the lower edge of the band about the magnitude to that of the upper edge.
    """
    size, wide = np.abs(off), float(ndtri((1 + CONFIDENCE) / 2))
    at_s = _last_exit_s(grid_s, size, limit)
    draws = _normal_draws()
    moved_s = np.array([_last_exit_s(grid_s, np.abs(off + draw * u), limit) for draw in draws])
    u_s = float(np.sqrt(np.mean((moved_s - at_s) ** 2)))
    soonest_s, latest_s = (_last_exit_s(grid_s, size + sign * wide * u, limit) for sign in (-1, 1))
    of_scatter_s = np.mean([_last_exit_s(grid_s, np.abs(draw) * u, limit) for draw in draws])
    interval_s = Interval(soonest_s, latest_s, float(of_scatter_s))
    ends_outside, may_end_outside = bool(size[-1] > limit), bool(size[-1] + wide * u[-1] > limit)
    return Settling(at_s, u_s, interval_s, ends_outside, may_end_outside, at_s == 0)


def _normal_draws() -> Array:
    """Equally probable values of a standard normal distribution, (n,), with a standard deviation of 1."""
    draws = ndtri((np.arange(DRAWS) + 0.5) / DRAWS)
    return np.asarray(draws / np.std(draws))


def _last_exit_s(grid_s: Array, size: Array, limit: float) -> float:
    """Time at which a magnitude last falls to its limit; 0 if it is never above, the end if it is above at the end."""
    outside = np.flatnonzero(size > limit)
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    if last == len(size) - 1:
        return float(grid_s[-1])
    part = (size[last] - limit) / (size[last] - size[last + 1])
    return float(grid_s[last] + part * (grid_s[last + 1] - grid_s[last]))
