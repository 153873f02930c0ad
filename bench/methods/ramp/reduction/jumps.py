"""Steps in a slowly changing record: "jumps" of an accelerometer's bias on a temperature ramp (equations 6.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench.metrology.least_squares import Array

SIGNIFICANCE = 5.0
"""Minimum size of a step in standard uncertainties of its own fit."""


@dataclass(frozen=True, slots=True)
class Jump:
    """A step between the samples `after - 1` and `after`; `size` is after minus before, in the unit of the record.

    `u` is its standard uncertainty from the scatter of the neighbours about their fit.
    """

    after: int
    size: float
    u: float


def find_jumps(time_s: Array, value: Array, *, threshold: float, window: int = 8) -> list[Jump]:
    """Find steps larger than `threshold` in `value` (n,) over increasing `time_s`, in time order.

    Between every two samples a common slope and a step are fitted to the `window` neighbours on either side. A ramp has
    no step; nor has a curve, whose even part cancels between the two sides. Of several steps within 2 × `window`
    samples the largest is the jump, the earliest of equals. The first and the last `window` samples, without neighbours
    on one side, are not judged. `window` is at least 2.
    """
    if len(value) < 2 * window:
        return []
    step, u = _steps(time_s, value, window)
    candidates = np.flatnonzero((np.abs(step) > threshold) & (np.abs(step) > SIGNIFICANCE * u))
    largest_first = candidates[np.argsort(-np.abs(step[candidates]), kind="stable")]
    suppressed = np.zeros(len(step), dtype=np.bool_)
    found = []
    for i in largest_first:
        if not suppressed[i]:
            suppressed[max(i - 2 * window, 0) : i + 2 * window + 1] = True
            found.append(Jump(int(i) + window, float(step[i]), float(u[i])))
    return sorted(found, key=lambda jump: jump.after)


def _steps(time_s: Array, value: Array, window: int) -> tuple[Array, Array]:
    """Step and its standard uncertainty at the n + 1 - 2 × window places that have all neighbours.

    The columns of the design matrix {1, time, side} are orthogonalised in turn, each window separately.
    """
    time = _centred(sliding_window_view(time_s, 2 * window))
    y = _centred(sliding_window_view(value, 2 * window))
    side = np.repeat([-0.5, 0.5], window)
    side = side - _projection(side, time)
    y = y - _projection(y, time)
    step = np.sum(side * y, axis=-1) / np.sum(side**2, axis=-1)
    scatter = np.sum((y - step[:, np.newaxis] * side) ** 2, axis=-1) / (2 * window - 3)
    return step, np.sqrt(scatter / np.sum(side**2, axis=-1))


def _centred(windows: NDArray[np.float64]) -> Array:
    return np.asarray(windows - windows.mean(axis=-1, keepdims=True))


def _projection(y: Array, onto: Array) -> Array:
    """Projection of each row of `y` onto the same row of `onto`."""
    share = np.sum(y * onto, axis=-1) / np.sum(onto**2, axis=-1)
    return np.asarray(share[:, np.newaxis] * onto)
