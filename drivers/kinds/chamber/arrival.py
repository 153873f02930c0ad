"""Arrival of the air of a chamber at a set point, judged by polls that may be minutes apart."""

from __future__ import annotations

from drivers.kinds.chamber.description import FollowOptions, TemperatureRange
from drivers.kinds.chamber.following import FollowWatch
from drivers.values import ChamberState

SET_POINT_TOLERANCE_C = 0.5  # tolerance of the commanded set point, which controllers round


class Arrival:
    """Approach of the air to a set point, from the first poll on.

    It has arrived when the active set point is at the target and the air within `follow.band`. The time limit is the
    distance at the slowest approach that `follow` allows (`gain` in every `over`), plus `settle`.
    """

    def __init__(self, target_c: float, follow: FollowOptions, limits: TemperatureRange) -> None:
        self.target_c = target_c
        self._follow, self._limits = follow, limits
        self._watch: FollowWatch | None = None
        self._due_s = 0.0

    def has_arrived(self, state: ChamberState) -> bool:
        """Return whether active set point and air are at the target."""
        at_rest = abs(state.set_point_c - self.target_c) <= SET_POINT_TOLERANCE_C
        return at_rest and abs(state.process_value_c - self.target_c) <= self._follow.band

    def problem(self, at_s: float, state: ChamberState) -> str:
        """Evaluate one poll at the time `at_s`; return the reason why the air cannot arrive, or "" while it may."""
        if self._watch is None:
            longest_s = self.longest_s(state)  # a set point that jumped is far from the air for longer than `settle`
            self._watch = FollowWatch(self._follow.model_copy(update={"settle": longest_s}), self._limits)
            self._due_s = at_s + longest_s
        if abs(state.target_c - self.target_c) > SET_POINT_TOLERANCE_C:
            return f"the set point was changed by another master from {self.target_c:g} °C to {state.target_c:g} °C"
        if wrong := self._watch.problem(at_s, state.process_value_c, state.set_point_c, commanded=True):
            return f"{wrong}; it is at {state.process_value_c:.1f} °C"
        if at_s > self._due_s and not self.has_arrived(state):
            return f"the air is at {state.process_value_c:.1f} °C, and should have been at {self.target_c:g} °C by now"
        return ""

    def longest_s(self, state: ChamberState) -> float:
        """Maximum time of a working chamber until arrival."""
        distance_c = abs(state.process_value_c - self.target_c)
        return distance_c / self._follow.gain * self._follow.over + self._follow.settle
