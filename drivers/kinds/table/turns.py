"""Angles over whole turns, from a controller that reports them within one."""

from __future__ import annotations

import math

from drivers.kinds.table.axis import Mode, State
from drivers.kinds.table.description import AngleRange

TURN_DEG = 360.0
LONGEST_LEG_DEG = 120.0  # well below half a turn, so that the shorter direction is unambiguous


class TurnCounter:
    """Counts turns from one poll of an axis to the next.

    An axis with ends stays within the turn centred on its travel. One without ends starts between -180° and 180°; from
    then on the travel between two polls is predicted as mean rate times time, correct within half a turn unless the
    rate changes unobserved. A sine stays within half a turn of its centre.
    """

    def __init__(self, ends: AngleRange | None) -> None:
        self._ends = ends
        self._last: tuple[float, State] | None = None
        self._centre_deg = 0.0  # angle of the axis before an oscillation

    def count(self, at_s: float, state: State) -> State:
        """Resolve the turn of a state at a time."""
        near_deg = self._expected_deg(at_s, state)
        angle_deg = near_deg + math.remainder(state.angle_deg - near_deg, TURN_DEG)
        if state.mode is not Mode.SYNTHESIS:
            self._centre_deg = angle_deg
        state = state._replace(angle_deg=angle_deg)
        self._last = at_s, state
        return state

    def _expected_deg(self, at_s: float, state: State) -> float:
        """Predicted angle of the axis."""
        if self._ends is not None:
            return (self._ends.min + self._ends.max) / 2
        if self._last is None:
            return 0.0
        last_s, last = self._last
        if Mode.SYNTHESIS in (last.mode, state.mode):
            return self._centre_deg
        return last.angle_deg + (last.rate_dps + state.rate_dps) / 2 * (at_s - last_s)
