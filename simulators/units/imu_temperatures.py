"""Temperatures in an inertial unit: of its sensors, which gradients set apart, and of its ideal thermometers.

A triad has a common temperature T. A sensor that is nearer to the table takes a share of the difference from the room,
to which the shaft of the table leads: T + share (room - T). So the sensors differ by more, the farther the chamber is
from the temperature of the room.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from simulators.physics.thermal import Thermal
from simulators.units.imu_drawn import CircuitTruth
from simulators.units.imu_file import NAMES, ImuThermal
from simulators.units.unit_temperatures import Thermometer, ThermometerErrors, UnitTemperatures

Array = NDArray[np.float64]
SENSORS = ("accelerometers", "gyros")
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in NAMES)
CIRCUIT = "circuit"
"""Name of the temperature circuit beside those of the thermometers: SENSORS of the triads, CHANNELS of the sensors."""


class ImuTemperatures:
    """Temperatures of accelerometers and gyros; `gyros` is the index of these in the world's temperatures."""

    def __init__(
        self, accelerometers: UnitTemperatures, thermal: Thermal, gyros: int, model: ImuThermal, room_c: float
    ) -> None:
        self._accelerometers, self._thermal, self._gyros, self._room_c = accelerometers, thermal, gyros, room_c
        self._shares = np.array(model.to_room.shares)

    @property
    def has_gradients(self) -> bool:
        """True if the sensors of a triad have different temperatures."""
        return bool(self._shares.any())

    @property
    def sensors_c(self) -> Array:
        """Temperature of each of CHANNELS, (6,)."""
        triads_c = [self._accelerometers.sensor_c, self._thermal.sensor_c(self._gyros)]
        common_c = np.repeat(triads_c, len(NAMES))
        return np.asarray(common_c + self._shares * (self._room_c - common_c))

    @property
    def follows(self) -> Array:
        """Change of the temperature of each accelerometer with that of the triad, (3, 1)."""
        return 1 - self._shares[: len(NAMES), np.newaxis]

    def thermometer_c(self, name: str) -> float:
        """Temperature of an ideal thermometer with lag at a triad, a sensor, or the temperature circuit."""
        of_gyros = name.startswith("gyro")
        common_c = self._thermal.thermometer_c(self._gyros) if of_gyros else self._accelerometers.thermometer_c
        share = float(self._shares[CHANNELS.index(name)]) if name in CHANNELS else 0.0
        return common_c + share * (self._room_c - common_c)


class TemperatureCircuit:
    """The unit's own thermometer, whose output is a frequency; it is among the accelerometers."""

    def __init__(self, truth: CircuitTruth, start_c: float, noise: Generator) -> None:
        self._truth, self._noise = truth, noise
        self._at = Thermometer(start_c, ThermometerErrors(), 0.0, noise)

    def readings_hz(self, at_s: Array, now_s: float, now_c: float) -> Array:
        """Output at times since the last call, for a unit that has reached `now_c`."""
        noise_hz = self._truth.noise_hz * self._noise.standard_normal(len(at_s))
        return self._truth.output_hz(self._at.readings_c(at_s, now_s, now_c)) + noise_hz
