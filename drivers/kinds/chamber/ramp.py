"""Course of a set point from one temperature to another, by the controller's own ramp or a series of set points."""

from __future__ import annotations

import math
from typing import NamedTuple

ARRIVED_WITHIN_C = 1e-4  # a few times the last bit of a float32: the active set point is computed, not copied
FAR_AWAY_POLL_S = 5.0  # interval of polls while the end of a ramp is far away
OWN_RAMP_WITHIN_C, OWN_RAMP_WITHIN_S = 1.0, 30.0  # tolerance of a controller's own ramp


class RampProfile(NamedTuple):
    """One ramp, begun at the loop time `began_s`; without `step_s` the controller ramps by itself."""

    start_c: float
    target_c: float
    rate_c_per_s: float
    began_s: float
    step_s: float | None

    @property
    def duration_s(self) -> float:
        """Duration of the ramp."""
        return abs(self.target_c - self.start_c) / self.rate_c_per_s

    def set_point_c(self, at_s: float) -> float:
        """Set point at a loop time: the end of the current step, finally the target."""
        if self.step_s is None:
            return self.target_c
        steps = math.floor((at_s - self.began_s) / self.step_s) + 1
        way_c = self.target_c - self.start_c
        return self.start_c + math.copysign(min(steps * self.step_s * self.rate_c_per_s, abs(way_c)), way_c)

    def pause_s(self, at_s: float, set_point_c: float, poll_s: float) -> float:
        """Time until the next poll, if the active set point is `set_point_c`."""
        if self.step_s is not None:
            return self.step_s - (at_s - self.began_s) % self.step_s
        left_s = abs(self.target_c - set_point_c) / self.rate_c_per_s
        return max(poll_s, min(left_s / 2, FAR_AWAY_POLL_S))


class OwnRamp(NamedTuple):
    """A controller's own ramp with little feedback: the expected set point over time."""

    start_c: float
    target_c: float
    rate_c_per_s: float
    began_s: float

    def set_point_c(self, at_s: float) -> float:
        """Expected active set point at a loop time."""
        way_c = self.target_c - self.start_c
        done_c = self.rate_c_per_s * (at_s - self.began_s)
        return self.target_c if done_c >= abs(way_c) else self.start_c + math.copysign(done_c, way_c)

    def is_at(self, set_point_c: float, at_s: float) -> bool:
        """Return whether a reported set point agrees with the expected one, within 1 °C and half a minute."""
        off_c = abs(set_point_c - self.set_point_c(at_s))
        return off_c <= OWN_RAMP_WITHIN_C + self.rate_c_per_s * OWN_RAMP_WITHIN_S
