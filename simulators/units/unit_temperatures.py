"""Temperatures of one unit for its simulation: sensor, converter, and thermometer readings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from simulators.faults.instrument_faults import FaultPlan
from simulators.physics.corrections import Table, read_of
from simulators.physics.thermal import Thermal
from simulators.units.course import Course, Temperatures
from simulators.units.history import History
from simulators.units.unit_file import ThermostatModel, UnitFile

Array = NDArray[np.float64]


class UnitTemperatures:
    """Temperature model of a unit: by the chamber alone, or a thermostat; converter in the chamber or outside."""

    def __init__(self, thermal: Thermal, index: int, unit: UnitFile, start_c: float, thermometer_s: float) -> None:
        self._thermal, self._index = thermal, index
        self._outside_c = None if unit.converter.in_chamber else unit.converter.temperature
        model = unit.thermal
        self._thermostat = None
        if model.thermostat is not None:
            self._thermostat = Thermostat(model.thermostat, model.sensor_time_constant, thermometer_s, start_c)
        self.course = Course(start_c, self.board_c)

    def follow(self, now_s: float, powered: bool) -> None:
        """Follow the chamber, which is computed up to now."""
        if self._thermostat is not None:
            self._thermostat.advance(now_s, self._thermal.case_c(self._index), powered)
        self.course.go_on(
            now_s,
            Temperatures(
                self.sensor_c, self.sensor_rate_c_per_s, self.thermometer_c, self.board_c, self.board_thermometer_c
            ),
        )

    @property
    def sensor_c(self) -> float:
        """Temperature of the sensor inside the accelerometer."""
        return self._thermal.sensor_c(self._index) if self._thermostat is None else self._thermostat.sensor_c

    @property
    def sensor_rate_c_per_s(self) -> float:
        """Rate of that temperature."""
        if self._thermostat is not None:
            return self._thermostat.rate_c_per_s
        return self._thermal.sensor_rate_c_per_s(self._index)

    @property
    def thermometer_c(self) -> float:
        """Temperature of an ideal thermometer with lag at it."""
        return self._thermal.thermometer_c(self._index) if self._thermostat is None else self._thermostat.thermometer_c

    @property
    def board_in_chamber(self) -> bool:
        """True if the converter is in the chamber."""
        return self._outside_c is None

    @property
    def board_c(self) -> float:
        """Temperature of the converter."""
        return self._thermal.board_c(self._index) if self._outside_c is None else self._outside_c

    @property
    def board_rate_c_per_s(self) -> float:
        """Rate of the converter's temperature."""
        return self._thermal.board_rate_c_per_s(self._index) if self._outside_c is None else 0.0

    @property
    def board_thermometer_c(self) -> float:
        """Temperature of an ideal thermometer with lag at the converter."""
        return self._thermal.board_thermometer_c(self._index) if self._outside_c is None else self._outside_c


class BoardState(NamedTuple):
    """A converter in the chamber at true times: temperatures of board, ideal thermometer and the unit's sensor.

    Also the drifting part of the unit's bias.
    """

    true_s: Array
    board_c: Array
    thermometer_c: Array
    sensor_c: Array
    drifted_g: Array


class Board:
    """Temperature of the converter of a unit over time; `history` is empty for one outside the chamber."""

    def __init__(self, temperatures: UnitTemperatures) -> None:
        self._temperatures = temperatures
        self.history = History(len(BoardState._fields))

    def followed_c(self, corners_s: Array, at_s: Array, drifted_g: Array) -> Array | None:
        """Temperatures at times; None outside the chamber. The history goes on from the first corner to the last."""
        if not self._temperatures.board_in_chamber:
            return None
        course, reached_s = self._temperatures.course, corners_s[1:]
        known = course.board_c(reached_s), course.board_thermometer_c(reached_s), course.sensor_c(reached_s)
        self.history.go_on(*BoardState(reached_s, *known, np.broadcast_to(drifted_g, reached_s.shape)))
        return course.board_c(at_s)

    def just_before_c(self, now_s: float, before_s: float, drifted_g: float) -> Array | None:
        """Temperature just before now, independent of the last call; None outside the chamber."""
        if not self._temperatures.board_in_chamber:
            return None
        temperatures = self._temperatures
        board_c = temperatures.board_c
        now = now_s, board_c, temperatures.board_thermometer_c, temperatures.sensor_c, drifted_g
        self.history.go_on(*BoardState(*(np.array([each]) for each in now)))
        return np.asarray(board_c - temperatures.board_rate_c_per_s * before_s)


def followed_c(faults: FaultPlan, at_unit_c: Array, room_c: float) -> Array:
    """Temperatures of an ideal thermometer at a unit, or that of the room if it is detached."""
    return np.full_like(at_unit_c, room_c) if faults.active("detached_thermometer") else at_unit_c


@dataclass(frozen=True, slots=True)
class ThermometerErrors:
    """Errors of a thermometer as drawn, in addition to the corrections of its `table`.

    These are °C to be added at readings in °C. The offset is that in the middle of a run; it changes linearly, by
    `drift_c` from start to end.
    """

    offset_c: float = 0.0
    gain: float = 0.0
    drift_c: float = 0.0
    table: Table = ((), ())


class Thermometer:
    """Readings of a thermometer from those of an ideal one, with errors and noise; a run of 0 s has no drift."""

    def __init__(self, errors: ThermometerErrors, noise_c: float, noise: Generator, run_s: float = 0.0) -> None:
        self._errors, self._noise_c, self._noise, self._run_s = errors, noise_c, noise, run_s

    def readings_c(self, at_s: Array, true_c: Array) -> Array:
        """Readings at times at which an ideal thermometer reads `true_c`."""
        right_c = true_c * (1 + self._errors.gain) + self._errors.offset_c
        if self._run_s:
            right_c = right_c + self._errors.drift_c * (at_s / self._run_s - 0.5)
        return read_of(right_c, self._errors.table) + self._noise_c * self._noise.standard_normal(len(at_s))


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
