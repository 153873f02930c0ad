"""Course of the temperatures of a unit: known whenever its world was looked at, straight lines in between."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEPT_S = 120.0  # outputs and thermometers ask for times since they were read last, a minute ago at most


class Temperatures(NamedTuple):
    """Temperatures in °C: of a sensor, with its rate in °C/s, and of an ideal thermometer with lag at the unit.

    Also of a converter board and of an ideal thermometer at it; those of a gyro have none.
    """

    sensor_c: float
    rate_c_per_s: float
    thermometer_c: float
    board_c: float = 0.0
    board_thermometer_c: float = 0.0


class Course:
    """Temperatures over true time for the last `KEPT_S`; those who ask for earlier ones get the earliest."""

    def __init__(self, start_c: float, board_c: float = 0.0) -> None:
        self._at_s = [0.0]
        self._known = [Temperatures(start_c, 0.0, start_c, board_c, board_c)]

    def go_on(self, at_s: float, now: Temperatures) -> None:
        """Add the temperatures at a time after the last one; at the last one they replace it."""
        if at_s <= self._at_s[-1]:
            self._known[-1] = now
            return
        self._at_s.append(at_s)
        self._known.append(now)
        if at_s - self._at_s[0] > 2 * KEPT_S:
            passed = bisect_right(self._at_s, at_s - KEPT_S) - 1
            del self._at_s[:passed], self._known[:passed]

    def corners_s(self, begin_s: float, end_s: float) -> Array:
        """Both times, and between them those at which a straight line ends."""
        first, last = bisect_right(self._at_s, begin_s), bisect_left(self._at_s, end_s)
        return np.array([begin_s, *self._at_s[first:last], end_s])

    def sensor_c(self, at_s: Array) -> Array:
        """Temperature of the sensor at times."""
        return np.interp(at_s, self._at_s, [each.sensor_c for each in self._known])

    def rate_c_per_s(self, at_s: Array) -> Array:
        """Rate of that temperature."""
        return np.interp(at_s, self._at_s, [each.rate_c_per_s for each in self._known])

    def thermometer_c(self, at_s: Array) -> Array:
        """Temperature of an ideal thermometer with lag at the unit."""
        return np.interp(at_s, self._at_s, [each.thermometer_c for each in self._known])

    def board_c(self, at_s: Array) -> Array:
        """Temperature of the converter."""
        return np.interp(at_s, self._at_s, [each.board_c for each in self._known])

    def board_thermometer_c(self, at_s: Array) -> Array:
        """Temperature of an ideal thermometer with lag at the converter."""
        return np.interp(at_s, self._at_s, [each.board_thermometer_c for each in self._known])


def straight(corners_s: Array, values: Array, at_s: Array) -> Array:
    """Rows of values (c, k) at the corners (k,), interpolated at times (n,) from the first to the last: (c, n)."""
    begins = at_s.searchsorted(corners_s)
    begins[0], begins[-1] = 0, len(at_s)
    times, spans_s = begins[1:] - begins[:-1], corners_s[1:] - corners_s[:-1]
    found = ((values[:, 1:] - values[:, :-1]) / spans_s).repeat(times, axis=1)  # far faster than to take by index
    found *= at_s - corners_s[:-1].repeat(times)
    found += values[:, :-1].repeat(times, axis=1)
    return found
