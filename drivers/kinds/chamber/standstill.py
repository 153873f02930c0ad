"""Detection of a frozen process value: bit-identical for ten minutes of a moving set point."""

from __future__ import annotations

import math

STANDSTILL_S = 600.0
SET_POINT_STANDS_S = 60.0  # a set point unchanged for so long is at rest


class StandstillWatch:
    """Monitors a process value and the set point that it should follow, at any polling intervals.

    A constant value is no fault while the set point is constant too, or while it is not polled.
    """

    def __init__(self) -> None:
        self._process_value = self._set_point = math.nan
        self._same_since_s = self._moved_at_s = -math.inf

    def frozen(self, at_s: float, process_value: float, set_point: float) -> bool:
        """Evaluate one poll at the loop time `at_s`; return whether the process value is frozen."""
        if process_value != self._process_value or at_s - self._moved_at_s > SET_POINT_STANDS_S:
            self._same_since_s = at_s
        if set_point != self._set_point:
            self._moved_at_s = at_s
        self._process_value, self._set_point = process_value, set_point
        return at_s - self._same_since_s >= STANDSTILL_S
