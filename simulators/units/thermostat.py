"""A heater in the case of an accelerometer that keeps its sensor at one temperature (equations 8.3).

    sensor   tau T' = case + rise - T       rise between `least_rise` and `most_rise`, in proportion to the error

It only heats: control is lost if the case is warmer than the set point minus the minimum rise, or colder than the set
point minus the maximum. In between its gain is so high that the sensor is at the balance temperature at once.
"""

from __future__ import annotations

import math

from simulators.units.unit_file import ThermostatModel


class Thermostat:
    """The sensor of one accelerometer and an ideal thermometer at it; times are true seconds and never go back."""

    def __init__(self, model: ThermostatModel, sensor_s: float, thermometer_s: float, start_c: float) -> None:
        self._model, self._sensor_s, self._thermometer_s = model, sensor_s, thermometer_s
        self._at_s = 0.0
        self.sensor_c = self.thermometer_c = start_c
        self.rate_c_per_s = 0.0

    def advance(self, to_s: float, case_c: float, powered: bool) -> None:
        """Compute the sensor up to `to_s`, when the case has `case_c`."""
        span_s = to_s - self._at_s
        if span_s <= 0:
            return
        before_c, follows = self.sensor_c, 1 - math.exp(-span_s / self._sensor_s)

        def towards(end_c: float) -> float:
            return before_c + (end_c - before_c) * follows

        model = self._model
        if powered:
            coldest_c, warmest_c = towards(case_c + model.least_rise), towards(case_c + model.most_rise)
            self.sensor_c = min(max(self.balance_c(case_c), coldest_c), warmest_c)
        else:
            self.sensor_c = towards(case_c)
        self.rate_c_per_s = (self.sensor_c - before_c) / span_s
        self.thermometer_c += (self.sensor_c - self.thermometer_c) * (1 - math.exp(-span_s / self._thermometer_s))
        self._at_s = to_s

    def balance_c(self, case_c: float) -> float:
        """Temperature at which power and error balance; within ± band of the set point, if the heater is able to."""
        model = self._model
        gain = (model.most_rise - model.least_rise) / (2 * model.band)
        return (case_c + model.least_rise + gain * (model.set_point + model.band)) / (1 + gain)
