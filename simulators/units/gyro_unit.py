"""A unit with one gyro in its place: its output, and the reading of its thermometer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simulators.faults.instrument_faults import OPEN_C, FaultPlan
from simulators.physics.attitude import to_unit
from simulators.physics.dynamics import POINTS, Follower, look_at_s, mean_input
from simulators.physics.noise import Noise
from simulators.units.accelerometer import Sent
from simulators.units.gyro import GyroTruth, Vectors, draw_gyro, noise_of_gyro
from simulators.units.gyro_file import GyroFile
from simulators.units.history import History
from simulators.units.sensor_temperatures import SensorTemperatures
from simulators.units.settings import WorldSettings
from simulators.units.surroundings import Surroundings
from simulators.units.unit_file import Draw, stream
from simulators.units.unit_temperatures import Thermometer, followed_c

Array = NDArray[np.float64]
LOOK_S = 0.02  # time step of a mean current during a motion of the table


def draw_gyro_unit(file: GyroFile, seed: int, place: str) -> GyroTruth:
    """Draw the gyro of one run with its output: every `{mean, sd}` from its own stream."""
    truth = draw_gyro(file.gyro, seed, place, supply_a=file.supply.current)

    def value(draw: Draw, *path: str) -> float:
        return draw.value(stream(seed, "uut", place, *path))

    if (sent := file.telemetry) is not None:
        truth = replace(
            truth, codes_per_pps=value(sent.S, "telemetry", "S"), zero_code=value(sent.zero, "telemetry", "zero"),
            noise_code=value(sent.noise, "telemetry", "noise"), code_bits=sent.bits,
            clock=value(sent.clock, "telemetry", "clock"),
        )  # fmt: skip
    if (flows := file.current) is not None:
        truth = replace(
            truth, amperes_per_pps=value(flows.S, "current", "S"), zero_a=value(flows.zero, "current", "zero")
        )
    return truth


class SimulatedGyro:
    """One gyro in its place, between the world and the instrument that measures its output."""

    def __init__(self, place: str, file: GyroFile, index: int, settings: WorldSettings, world: Surroundings) -> None:
        self.place = place
        self.settings = settings.places[place]
        self.truth = draw_gyro_unit(file, settings.seed, place)
        self.faults = FaultPlan(now_s=world.now)
        self._world = world
        self.temperatures = SensorTemperatures(world.thermal, index, settings.chamber.start_c)
        self._noise = noise_of_gyro(self.truth, settings.seed, place)
        dynamics = self.truth.dynamics
        self._follower = Follower(dynamics) if dynamics is not None else None
        self._thermometer = Thermometer(
            self.settings.thermometer, settings.thermometer_noise_c,
            stream(settings.seed, "noise", place, "thermometer"), settings.run_s,
        )  # fmt: skip
        self.powered_at_s: float | None = None
        self.history = History(2)  # true time, temperature of the sensor

    @property
    def sent(self) -> Sent:
        """Its conversion to codes."""
        return Sent(self.truth.clock, self.truth.zero_code, self.truth.noise_code)

    @property
    def swings(self) -> bool:
        """True if the input may reverse between two latches."""
        return self._follower is not None

    def charge_pulses(self, edges_s: Array) -> Array:
        """Pulses due in each interval between the consecutive times `edges_s`."""
        return self._mean_pps(edges_s) * np.diff(edges_s)

    def mean_codes(self, edges_s: Array) -> Array:
        """Codes of its electronics for the mean rate in each interval; before rounding."""
        return self.truth.codes(self._mean_pps(edges_s))

    def own_noise(self, name: str) -> Noise:
        """An independent copy of its noise, so that the readings of one observer do not affect those of another."""
        return noise_of_gyro(self.truth, self._world.settings.seed, f"{self.place}/{name}")

    def mean_volts(self, begin_s: float, end_s: float, noise: Noise, load_ohm: float) -> float:
        """Mean voltage of its output current across a load from `begin_s` to `end_s`; 0 without power.

        Dynamics are ignored: a reading is many times as long as its time constant.
        """
        if self.powered_at_s is None:
            return 0.0
        edges_s = np.linspace(begin_s, end_s, 1 + math.ceil((end_s - begin_s) / LOOK_S))
        sensed_pps = self._output_pps((edges_s[1:] + edges_s[:-1]) / 2, noise.mean(np.diff(edges_s)))
        if self.faults.active("dead"):
            sensed_pps = np.zeros_like(sensed_pps)
        return load_ohm * float(self.truth.current_a(self.truth.clipped_pps(sensed_pps)).mean())

    def _output_pps(self, at_s: Array, noise_dps: Array) -> Array:
        rate_dps, force_g = self._sensed(at_s)
        course, begin_s, end_s = self.temperatures.course, float(np.min(at_s)), float(np.max(at_s))
        corners_s = course.corners_s(begin_s, end_s)[1:]
        self.history.go_on(corners_s, course.sensor_c(corners_s))
        sensor_c = course.sensor_c(at_s)
        return self.truth.output_pps(rate_dps, force_g, sensor_c, noise_dps)

    def _mean_pps(self, edges_s: Array) -> Array:
        """Mean pulse rate in the intervals between consecutive times."""
        interval_s = np.diff(edges_s)
        if self.powered_at_s is None:
            return np.zeros_like(interval_s)
        look_s = look_at_s(edges_s, self.truth.delay_s)
        noise_dps = np.repeat(self._noise.mean(interval_s), len(POINTS))
        sensed_pps = self._output_pps(look_s.ravel(), noise_dps).reshape(look_s.shape)
        if self.faults.active("dead"):
            return np.zeros_like(interval_s)
        output_pps = self._follower.mean(sensed_pps, interval_s) if self._follower else mean_input(sensed_pps)
        return self.truth.clipped_pps(output_pps)

    def _sensed(self, at_s: Array) -> tuple[Vectors, Vectors]:
        """Rate in °/s and specific force in g, along the input, the pendulous and the output axis."""
        to_axes = to_unit(self._world.mount, self.settings.mount_angle_deg)
        turning_dps = to_axes @ self._world.kinematics.rate_dps(at_s)
        force_g = to_axes @ self._world.kinematics.force_g(at_s, self.settings.arm_m)
        return (turning_dps[0], turning_dps[2], turning_dps[1]), (force_g[0], force_g[2], force_g[1])

    def power(self, since_s: float | None) -> None:
        """Switch the power on at a time, or off."""
        self.powered_at_s = since_s

    def thermometer_c(self, at_s: Array) -> Array:
        """Readings of the thermometer at the unit at times since the last call, with its errors and noise."""
        true_c = followed_c(self.faults, self.temperatures.course.thermometer_c(at_s), self._world.settings.ambient_c)
        read_c = self._thermometer.readings_c(at_s, true_c)
        return np.full_like(read_c, OPEN_C) if self.faults.active("open_thermometer") else read_c
