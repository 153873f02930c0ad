"""Temperatures of a sensor in the chamber that has no converter of its own, such as a gyro."""

from __future__ import annotations

from simulators.physics.thermal import Thermal
from simulators.units.course import Course, Temperatures


class SensorTemperatures:
    """Follows the sensor with this index in the chamber's temperatures."""

    def __init__(self, thermal: Thermal, index: int, start_c: float) -> None:
        self._thermal, self._index = thermal, index
        self.course = Course(start_c)

    def follow(self, now_s: float) -> None:
        """Follow the chamber, which is computed up to now."""
        thermal, index = self._thermal, self._index
        now = thermal.sensor_c(index), thermal.sensor_rate_c_per_s(index), thermal.thermometer_c(index)
        self.course.go_on(now_s, Temperatures(*now))
