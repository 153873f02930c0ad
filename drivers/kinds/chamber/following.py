"""Monitoring of a chamber's air: it must approach its set point, stay there, and never run away.

The rules use only temperatures and times, so they apply to any make, load and ramp. A ramp faster than the chamber
breaks none of them while the air still approaches.
"""

from __future__ import annotations

import math

from drivers.kinds.chamber.description import FollowOptions, TemperatureRange

BEYOND_C = 10.0  # tolerance of the air beyond the limits of the bench: it overshoots at their ends
AWAY_C = 5.0  # farther from its set point, outside the band, the air gets only by the chamber's own power
ROOM_C = (15.0, 30.0)  # towards the room the air also drifts by itself: with an open door, without heating


class FollowWatch:
    """Monitors a process value and the active set point, both °C, at any polling intervals.

    A problem is valid for that poll only: the caller acts on it. Polls farther apart than `over` restart the check.
    """

    def __init__(self, options: FollowOptions, limits: TemperatureRange) -> None:
        self._is, self._limits = options, limits
        self._looked_s = -math.inf
        self._set_point_c = math.nan
        self._impossible = 0  # polls in a row
        self._from: tuple[float, float, bool] | None = None  # time and value of the last approach, and its side
        self._due_s = math.inf  # deadline for settling
        self._inside_since_s: float | None = None

    def problem(self, at_s: float, air_c: float, set_point_c: float, *, commanded: bool) -> str:
        """Evaluate the values of one poll, at the loop time `at_s`; return the problem of the chamber, or "".

        Until this program has `commanded` a set point, the air need not be near any.
        """
        if not self.is_possible(air_c):
            self._impossible += 1  # one poll may be a bad answer
            return f"the process value is far beyond {self.limits}" if self._impossible > 1 else ""
        self._impossible = 0
        if not commanded or at_s - self._looked_s > self._is.over:
            self._from, self._set_point_c = None, math.nan
        self._looked_s = at_s
        if set_point_c != self._set_point_c:
            self._set_point_c, self._due_s, self._inside_since_s = set_point_c, at_s + self._is.settle, None
        if not commanded:
            return ""
        if abs(air_c - set_point_c) > self._is.band:
            return self._outside(at_s, air_c, set_point_c)
        self._from = None
        if self._inside_since_s is None:
            self._inside_since_s = at_s
        return ""

    def is_possible(self, air_c: float) -> bool:
        """Return whether a process value is not far beyond the limits of the bench."""
        return self._limits.min - BEYOND_C <= air_c <= self._limits.max + BEYOND_C

    @property
    def limits(self) -> str:
        """Text of the bench's limits."""
        return f"the {self._limits.min:g} to {self._limits.max:g} °C of the bench"

    def _outside(self, at_s: float, air_c: float, set_point_c: float) -> str:
        """Problem of air outside the band, or "" while it approaches."""
        options, from_below = self._is, air_c < set_point_c
        if self._inside_since_s is not None and at_s - self._inside_since_s >= options.over:
            self._due_s = at_s + options.settle  # it had settled: a disturbance also gets the settling time
        self._inside_since_s = None
        if self._from is None or self._from[2] != from_below:
            self._from = at_s, air_c, from_below
        since_s, from_c, _ = self._from
        nearer_c = air_c - from_c if from_below else from_c - air_c
        if nearer_c >= options.gain:
            self._from = at_s, air_c, from_below
        elif nearer_c <= -AWAY_C and not ROOM_C[0] <= air_c <= ROOM_C[1] and (air_c > ROOM_C[0]) == (air_c > from_c):
            return (
                f"the air moves away from its set point: {-nearer_c:.1f} °C farther within {_minutes(at_s - since_s)}"
            )
        elif at_s - since_s >= options.over:
            return f"the air has not come {options.gain:g} °C closer to its set point within {_minutes(options.over)}"
        if at_s > self._due_s:
            return f"the air has not settled within {options.band:g} °C of its set point for {_minutes(options.settle)}"
        return ""


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.3g} min"
