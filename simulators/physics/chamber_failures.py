"""Failures of chambers: course of the air temperature independent of the set point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Failure = Literal["heater_dead", "cooling_dead", "runaway", "detached_sensor", "slow"]
HOTTEST_C, COLDEST_C = 180.0, -90.0  # final air temperature at full power
FULL_POWER_C_PER_S = 5 / 60
BY_ITSELF_C_PER_S = 1 / 60  # heat loss of an idle chamber to the room
SLOW_C_PER_S = 0.02 / 60


@dataclass(frozen=True, slots=True)
class Line:
    """A value that changes linearly from a true time on to its target, and stays there."""

    start_c: float
    began_s: float
    target_c: float
    rate_c_per_s: float

    def at(self, now_s: float) -> float:
        """Value at a true time."""
        way_c = self.target_c - self.start_c
        passed_s = now_s - self.began_s
        done_c = abs(way_c) if math.isinf(self.rate_c_per_s) else passed_s * self.rate_c_per_s
        return self.target_c if done_c >= abs(way_c) else self.start_c + math.copysign(done_c, way_c)


def failing_target(failure: Failure, set_point: Line, air_target_c: float, room_c: float) -> tuple[float, float]:
    """Target of the air from now on, °C, and rate, °C/s, given its target `air_target_c` so far.

    Without a heater it cannot exceed the room temperature, without cooling not fall below it. In a runaway the heater
    stays on. With the sensor in the room the controller heats, or cools, for ever. A slow chamber has almost no power.
    """
    target_c = set_point.target_c
    match failure:
        case "heater_dead" | "cooling_dead":
            end_c = min(target_c, room_c) if failure == "heater_dead" else max(target_c, room_c)
            by_itself = (end_c - air_target_c) * (room_c - air_target_c) > 0 and end_c == room_c
            return end_c, min(BY_ITSELF_C_PER_S, set_point.rate_c_per_s) if by_itself else set_point.rate_c_per_s
        case "runaway":
            return HOTTEST_C, FULL_POWER_C_PER_S
        case "detached_sensor":
            return HOTTEST_C if target_c > room_c else COLDEST_C, FULL_POWER_C_PER_S
        case "slow":
            return target_c, min(SLOW_C_PER_S, set_point.rate_c_per_s)
