"""Temperatures in an inertial unit: of its sensors, which gradients set apart, and of its ideal thermometers.

A triad has a common temperature T. A sensor that is nearer to the table takes a share of the difference from the room,
to which the shaft of the table leads: T + share (room - T). So the sensors differ by more, the farther the chamber is
from the temperature of the room.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from simulators.units.imu_drawn import CircuitTruth
from simulators.units.imu_file import NAMES, ImuThermal
from simulators.units.sensor_temperatures import SensorTemperatures
from simulators.units.unit_temperatures import Thermometer, ThermometerErrors, UnitTemperatures

Array = NDArray[np.float64]
SENSORS = ("accelerometers", "gyros")
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in NAMES)
CIRCUIT = "circuit"
"""Name of the temperature circuit beside those of the thermometers: SENSORS of the triads, CHANNELS of the sensors."""


class ImuTemperatures:
    """Temperatures of the sensors of both triads."""

    def __init__(
        self, accelerometers: UnitTemperatures, gyros: SensorTemperatures, model: ImuThermal, room_c: float
    ) -> None:
        self._accelerometers, self._gyros, self._room_c = accelerometers, gyros, room_c
        self._shares = np.array(model.to_room.shares)
        self.has_gradients = bool(self._shares.any())  # whether the sensors of a triad have different temperatures

    def follow(self, now_s: float, powered: bool) -> None:
        """Follow the chamber, which is computed up to now."""
        self._accelerometers.follow(now_s, powered)
        self._gyros.follow(now_s)

    def corners_s(self, begin_s: float, end_s: float) -> Array:
        """Times from the begin to the end between which all temperatures are straight."""
        return self._accelerometers.course.corners_s(begin_s, end_s)

    def sensors_c(self, at_s: Array) -> Array:
        """Temperature of each of CHANNELS at times (k,): (6, k)."""
        triads_c = [each.course.sensor_c(at_s) for each in (self._accelerometers, self._gyros)]
        common_c = np.repeat(triads_c, len(NAMES), axis=0)
        return np.asarray(common_c + self._shares[:, np.newaxis] * (self._room_c - common_c))

    def rates_c_per_s(self, at_s: Array) -> Array:
        """Rate of the temperature of each accelerometer at times (k,): (3, k)."""
        follows = 1 - self._shares[: len(NAMES), np.newaxis]
        return np.asarray(follows * self._accelerometers.course.rate_c_per_s(at_s))

    def thermometer_c(self, name: str, at_s: Array) -> Array:
        """Temperature of an ideal thermometer with lag at a triad, a sensor, or the temperature circuit, at times."""
        of_triad = self._gyros if name.startswith("gyro") else self._accelerometers
        common_c = of_triad.course.thermometer_c(at_s)
        share = float(self._shares[CHANNELS.index(name)]) if name in CHANNELS else 0.0
        return common_c + share * (self._room_c - common_c)


class TemperatureCircuit:
    """The unit's own thermometer, whose output is a frequency; it is among the accelerometers."""

    def __init__(self, truth: CircuitTruth, noise: Generator) -> None:
        self._truth, self._noise = truth, noise
        self._at = Thermometer(ThermometerErrors(), 0.0, noise)

    def readings_hz(self, at_s: Array, true_c: Array) -> Array:
        """Output at times at which the unit has `true_c`."""
        noise_hz = self._truth.noise_hz * self._noise.standard_normal(len(at_s))
        return self._truth.output_hz(self._at.readings_c(at_s, true_c)) + noise_hz
