"""Simulated flights: a calibrated unit measures a known change of velocity, and `bench compensate` gives it back.

The profile of specific force is made of raised cosines, whose integrals are known without any arithmetic on counts.
The simulated converters count the exact integral of their output over each interval, at the true temperature, with the
noise of the unit, and from whatever was left in them; the reduction sees whole counts that wrap, and temperatures by
the thermometer of the calibration. A unit that sends codes gives the rounded mean of each interval; a voltmeter reads
the output at the rows. Nothing here is computed by a reduction.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.physics.integrator import Integrator
from simulators.units.accelerometer import Decoding, Hysteresis, Through, UnitTruth, noise_of
from simulators.units.unit_file import stream
from simulators.units.unit_temperatures import ThermometerErrors

Array = NDArray[np.float64]
APERTURE_S = 0.02  # over which a voltmeter averages
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
NODES, WEIGHTS = (NODES + 1) / 2, WEIGHTS / 2  # of an interval of length 1


@dataclass(frozen=True)
class Push:
    """A raised cosine of specific force, of a peak in m/s², beginning at a time and lasting for a time in s."""

    begin_s: float
    lasts_s: float
    peak_mps2: float

    def at(self, time_s: Array) -> Array:
        part = np.clip((time_s - self.begin_s) / self.lasts_s, 0, 1)
        return self.peak_mps2 * (1 - np.cos(2 * np.pi * part)) / 2

    def velocity_mps(self, time_s: Array) -> Array:
        """Its integral from its beginning."""
        part = np.clip((time_s - self.begin_s) / self.lasts_s, 0, 1)
        return self.peak_mps2 * self.lasts_s * (part - np.sin(2 * np.pi * part) / (2 * np.pi)) / 2


@dataclass(frozen=True)
class Profile:
    """A constant specific force in m/s² with pushes."""

    constant_mps2: float
    pushes: tuple[Push, ...] = ()

    def at(self, time_s: Array) -> Array:
        """Specific force at times."""
        return self.constant_mps2 + np.sum([push.at(time_s) for push in self.pushes], axis=0)

    def velocity_mps(self, time_s: Array) -> Array:
        """Change of velocity from time 0."""
        return self.constant_mps2 * time_s + np.sum([push.velocity_mps(time_s) for push in self.pushes], axis=0)


@dataclass(frozen=True)
class Flight:
    """Profiles along x, y and z (of a single channel its input, pendulous and output axis), and the temperature.

    The temperature of the unit goes linearly from `from_c` to `to_c`.
    """

    profiles: tuple[Profile, Profile, Profile]
    from_c: float
    to_c: float
    lasts_s: float = 300.0
    every_s: float = 0.1

    @property
    def time_s(self) -> Array:
        """Times of the readings."""
        return np.arange(round(self.lasts_s / self.every_s) + 1) * self.every_s

    def temperature_c(self, time_s: Array) -> Array:
        """True temperature at times."""
        return self.from_c + (self.to_c - self.from_c) * time_s / self.lasts_s


@dataclass(frozen=True)
class Sensor:
    """One accelerometer with its converter, in a world of a seed.

    `before_c` are temperatures that it has had one after the other before the flight, for its hysteresis, and
    `drifted_g` is its drift. `fixed_c` is the temperature of an accelerometer with a thermostat: the temperature of the
    flight is that of its converter then. `through` is what makes volts or codes of the current; None for pulses.
    """

    truth: UnitTruth
    name: str
    seed: int
    gravity_mps2: float
    before_c: tuple[float, ...]
    drifted_g: float = 0.0
    fixed_c: float | None = None
    through: Through = None

    def moved_g(self, flight: Flight, begin_s: Array | None = None) -> Array:
        """Bias beside the polynomial over temperature, in intervals from times on: (n, 1); by default those of rows."""
        begin_s = flight.time_s[:-1] if begin_s is None else begin_s
        play = Hysteresis(self.truth, self.before_c[0])
        for at_c in self.before_c[1:]:
            play.bias_g(at_c)
        if self.fixed_c is not None:
            return np.full((len(begin_s), 1), play.bias_g(self.fixed_c) + self.drifted_g)
        warming_g = self.truth.kd * (flight.to_c - flight.from_c) / flight.lasts_s
        steps = [play.bias_g(at_c) for at_c in flight.temperature_c(begin_s).tolist()]
        return np.array(steps)[:, np.newaxis] + warming_g + self.drifted_g

    def pulses(self, flight: Flight, axis: int) -> Array:
        """Charge in pulses in each interval between two readings."""
        return self.means(flight, axis, flight.time_s[:-1], flight.every_s) * flight.every_s

    def samples(self, flight: Flight, axis: int) -> Array:
        """Codes at the rows, means of the intervals before them; or volts, means of a short time about the rows."""
        if not isinstance(self.through, Decoding):
            return self.means(flight, axis, flight.time_s - APERTURE_S / 2, APERTURE_S)
        codes = self.means(flight, axis, flight.time_s - flight.every_s, flight.every_s)
        noise = stream(self.seed, "flight", self.name, "codes").standard_normal(len(codes))
        return np.rint(codes + self.truth.noise_code * noise)

    def noise_density_g(self, flight: Flight) -> float:
        """Density of the white noise that a velocity from its output has, in g/√Hz."""
        if self.through is None:
            return self.truth.noise_density
        if not isinstance(self.through, Decoding):
            return self.truth.noise_density * math.sqrt(flight.every_s / APERTURE_S)
        code_g = self.truth.noise_code / abs(self.truth.codes_per_a * self.truth.scale_a_per_g)
        return math.hypot(self.truth.noise_density, code_g * math.sqrt(2 * flight.every_s))

    def means(self, flight: Flight, axis: int, begin_s: Array, lasts_s: float) -> Array:
        """Mean outputs (n,) over intervals of one length from times (n,) on."""
        at_s = begin_s[:, np.newaxis] + lasts_s * NODES
        own_c = flight.temperature_c(at_s)
        order = (axis, (axis + 1) % 3, (axis + 2) % 3)
        along, pendulous, output = (flight.profiles[each].at(at_s) / self.gravity_mps2 for each in order)
        noise = noise_of(self.truth, self.seed, f"flight/{self.name}").mean(np.full(len(begin_s), lasts_s))
        moved_g = self.moved_g(flight, begin_s) + noise[:, np.newaxis]
        sensor_c = own_c if self.fixed_c is None else np.full_like(own_c, self.fixed_c)
        current_a = self.truth.current_a((along, pendulous, output), sensor_c, moved_g)
        return np.asarray(self.truth.output(current_a, self.through, None if self.fixed_c is None else own_c) @ WEIGHTS)

    def counters(self, flight: Flight, axis: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Readings of its two counters, which wrap and begin anywhere."""
        draws = stream(self.seed, "flight", self.name, "counters")
        size = 1 << self.truth.counter_bits
        pulses = self.pulses(flight, axis)
        left = math.copysign(float(draws.uniform(0, 1)), float(pulses[0]))  # by what it counted before
        converter = Integrator(left, *(int(draws.integers(size)) for _ in range(2)))
        positive, negative = converter.count(np.concatenate(([0.0], pulses)))
        return positive % size, negative % size


def write_record(path: Path, flight: Flight, sensors: Sequence[Sensor], thermometer: ThermometerErrors) -> None:
    """Write what a data logger would: times, indicated temperature, counters or samples."""
    time_s = flight.time_s
    columns: dict[str, Array] = {"t_s": time_s, "T_C": indicated_c(thermometer, flight.temperature_c(time_s))}
    for axis, sensor in enumerate(sensors):
        if sensor.through is not None:
            columns[sensor.name] = sensor.samples(flight, axis)
            continue
        for sign, counts in zip(("pos", "neg"), sensor.counters(flight, axis), strict=True):
            columns[f"{sensor.name}_{sign}"] = counts
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def indicated_c(thermometer: ThermometerErrors, true_c: Array) -> Array:
    """Reading of a thermometer with a drawn offset and gain."""
    assert not thermometer.table[0]
    return true_c * (1 + thermometer.gain) + thermometer.offset_c
