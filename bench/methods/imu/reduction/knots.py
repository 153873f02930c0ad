"""Temperature compensation of an inertial unit: zero and scale factor, linear between knots (equations 4.5).

It converts a reading to a physical value, and to the reading at the nominal temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array
from bench.metrology.temperature_checks import beyond_possible

Extrapolation = Literal["hold", "linear", "reject"]
SAME_KNOT_C = 0.5


@dataclass(frozen=True, slots=True)
class TemperatureTable:
    """Zero in pulse/s and scale factor, pulse/s/g or pulse/°, of one channel at knots (k,) of rising temperature."""

    temperature_c: Array
    zero_pps: Array
    scale: Array

    @property
    def usable(self) -> bool:
        """True if there are at least two knots to interpolate between."""
        return len(self.temperature_c) > 1

    def covers(self, temperature_c: Array) -> NDArray[np.bool_]:
        """Mask of temperatures (n,) between the first knot and the last."""
        return np.asarray((self.temperature_c[0] <= temperature_c) & (temperature_c <= self.temperature_c[-1]))

    def at(self, temperature_c: Array, extrapolation: Extrapolation) -> tuple[Array, Array]:
        """Zero and scale factor at temperatures (n,); NaN outside the knots without extrapolation."""
        inside = self.covers(temperature_c)
        if extrapolation == "hold":
            temperature_c = np.clip(temperature_c, self.temperature_c[0], self.temperature_c[-1])
        upper = np.clip(np.searchsorted(self.temperature_c, temperature_c), 1, len(self.temperature_c) - 1)
        lower = upper - 1
        width_c = self.temperature_c[upper] - self.temperature_c[lower]
        part = (temperature_c - self.temperature_c[lower]) / width_c
        if extrapolation == "reject":
            part = np.where(inside, part, np.nan)
        zero_pps, scale = (
            values[lower] + part * (values[upper] - values[lower]) for values in (self.zero_pps, self.scale)
        )
        return zero_pps, scale


def temperature_table(knots: Array) -> TemperatureTable:
    """Table from temperatures, zeros and scale factors (n, 3) in any order.

    Neighbours closer than 0.5 °C become their mean; a knot with missing values is left out.
    """
    knots = knots[np.isfinite(knots).all(axis=-1)].T
    knots = knots[:, np.argsort(knots[0])]
    starts = np.flatnonzero(np.diff(knots[0], prepend=-np.inf) >= SAME_KNOT_C)
    merged = np.add.reduceat(knots, starts, axis=1) / np.diff(starts, append=knots.shape[1]) if len(starts) else knots
    return TemperatureTable(*merged)


@dataclass(frozen=True, slots=True)
class Compensated:
    """Readings after compensation, arrays (n,): in g or °/s, and in pulse/s at the nominal temperature.

    NaN without a reading, a working thermometer or a table, or outside the knots without extrapolation. `extrapolated`
    marks temperatures outside of the knots.
    """

    value: Array
    nominal_pps: Array
    extrapolated: NDArray[np.bool_]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def compensate(
    table: TemperatureTable, temperature_c: Array, raw_pps: Array, nominal_c: float, extrapolation: Extrapolation
) -> Compensated:
    """Compensate readings (n,) of one channel at temperatures (n,), and convert them to the nominal temperature."""
    if not table.usable:
        unknown = np.full(len(raw_pps), np.nan)
        return Compensated(unknown, unknown, np.zeros(len(raw_pps), dtype=np.bool_))
    told_c = np.where(beyond_possible(temperature_c), np.nan, temperature_c)
    zero_pps, scale = table.at(told_c, extrapolation)
    nominal_zero_pps, nominal_scale = table.at(np.array([nominal_c]), extrapolation)
    value = (raw_pps - zero_pps) / scale
    return Compensated(value, value * nominal_scale + nominal_zero_pps, np.isfinite(told_c) & ~table.covers(told_c))


@dataclass(frozen=True, slots=True)
class ModelCheck:
    """Interpolation error of the inner knots from straight lines between their neighbours; arrays (k - 2,).

    `error` is the value between its neighbours minus the value of the knot; `curvature` the second divided difference
    times 2, in the unit of the values per °C². Leaving out an inner knot doubles the interval, so that the error of the
    full table is about a quarter.
    """

    error: Array
    curvature: Array


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def check_model(temperature_c: Array, values: Array) -> ModelCheck:
    """Leave out each knot (k,) except the ends in turn; temperatures rise."""
    below_c, at_c, above_c = temperature_c[:-2], temperature_c[1:-1], temperature_c[2:]
    below, at, above = values[:-2], values[1:-1], values[2:]
    between = below + (at_c - below_c) / (above_c - below_c) * (above - below)
    error = between - at
    return ModelCheck(error, 2 * error / ((at_c - below_c) * (above_c - at_c)))
