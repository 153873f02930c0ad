"""Specific force and velocity from the counts of calibrated channels, compensated for temperature (equations 2.5, 4.5).

The net pulses between two readings, over the time between them, are the mean output of that interval: no rate is
sampled, and a fraction of a pulse that one interval lacks is in the next. So quantisation is in a velocity twice, at
the first reading and at the last. A converter with one charge integrator fires a pulse when its charge is a whole one
away from the last: what it holds has the sign of its last pulse, half of one in the mean. Errors of the calibration are
the same throughout a record: their effects on the specific force are integrated with their signs, and only then
squared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Beyond, Compensation, Curve, values_of
from bench.metrology.least_squares import Array
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel

ROUNDS = 6  # each iteration reduces the error by a factor of the size of cross-coupling and nonlinearity, some 1e-3
PER_ROOT_2 = 0.5**0.5  # a one-sided density N gives a mean over t a standard deviation of N / sqrt(2 t)


@dataclass(frozen=True, slots=True)
class CountRecord:
    """Readings of counters and thermometer at increasing times, (n,) each.

    `net_pulses` (n - 1,) of each channel are those between two readings, positive less negative, NaN if unknown.
    Between two readings the temperature is their mean. `own_c` are the temperatures of channels with a thermometer of
    their own.
    """

    time_s: Array
    temperature_c: Array
    net_pulses: Mapping[str, Array]
    own_c: Mapping[str, Array] = field(default_factory=dict)

    def between_c(self, channel: str) -> Array:
        """Temperature of a channel in each interval, (n - 1,)."""
        read_c = self.own_c.get(channel, self.temperature_c)
        return np.asarray((read_c[1:] + read_c[:-1]) / 2)

    def output_pps(self, channel: str) -> Array:
        """Mean output of a channel in each interval, (n - 1,)."""
        return np.asarray(_charge(self.net_pulses[channel]) / np.diff(self.time_s))


@dataclass(frozen=True, slots=True)
class Gravity:
    """Local gravity of a calibration, its unit of specific force, and the standard uncertainty."""

    mps2: float
    u_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class SpecificForce:
    """Mean specific force (m,) in g along the axis of a channel in each interval between two readings.

    `errors` are the effects of one standard uncertainty of each independent error of the calibration on it, (m,) each.
    `count_g` (m,) is the specific force of one pulse in the interval, `outside` (m,) masks temperatures out of range.
    """

    force_g: Array
    errors: tuple[Array, ...]
    count_g: Array
    seconds: Array
    outside: NDArray[np.bool_]

    def u_g(self, noise_g: float = 0.0) -> Array:
        """Standard uncertainty (m,) of each value; `noise_g` is the density of white noise in g/√Hz."""
        squares = (RESOLUTION_COUNTS * self.count_g) ** 2 + (PER_ROOT_2 * noise_g) ** 2 / self.seconds
        for error in self.errors:
            squares += error**2
        return np.sqrt(squares)

    def u_mps2(self, gravity: Gravity, noise_g: float = 0.0) -> Array:
        """The same in m/s²."""
        return np.hypot(gravity.mps2 * self.u_g(noise_g), gravity.u_mps2 * self.force_g)


@dataclass(frozen=True, slots=True)
class Velocity:
    """Integral (n,) in m/s of the specific force from the first reading to each, and its standard uncertainties (n,).

    `u_model_mps` is due to the calibration and gravity, `u_count_mps` to the fractions of a pulse at both ends,
    `u_noise_mps` to white noise.
    """

    velocity_mps: Array
    u_model_mps: Array
    u_count_mps: Array
    u_noise_mps: Array

    @property
    def u_mps(self) -> Array:
        """Combined standard uncertainty (n,)."""
        return np.sqrt(self.u_model_mps**2 + self.u_count_mps**2 + self.u_noise_mps**2)


def specific_forces(
    record: CountRecord, channels: Mapping[str, Compensation], beyond: Beyond = "hold"
) -> dict[str, SpecificForce]:
    """Specific force along the axes of `channels`, whose compensations have force terms.

    `channels` contains the channels of their cross-coupling, and `record` all of them.
    """
    seconds = np.diff(record.time_s)
    axes = {
        name: _Axis.of(known, record.output_pps(name), record.between_c(name), beyond)
        for name, known in channels.items()
    }
    forces = {name: axis.uncoupled_g for name, axis in axes.items()}
    for _ in range(ROUNDS):
        forces = {name: axis.force_g(forces[name], forces) for name, axis in axes.items()}
    return {
        name: SpecificForce(
            force_g=forces[name],
            errors=tuple(axis.errors(forces[name], forces)),
            count_g=1 / np.abs(axis.scale) / seconds,
            seconds=seconds,
            outside=axis.outside,
        )
        for name, axis in axes.items()
    }


def integrate(force: SpecificForce, gravity: Gravity, noise_g: float = 0.0) -> Velocity:
    """Integrate a specific force to velocity; `noise_g` is the density of white noise in g/√Hz."""
    velocity_gs = _integral(force.force_g, force.seconds)
    squares = (gravity.u_mps2 / gravity.mps2 * velocity_gs) ** 2
    for error in force.errors:
        squares += _integral(error, force.seconds) ** 2
    elapsed_s = _integral(np.ones_like(force.seconds), force.seconds)
    counted = RESOLUTION_COUNTS * force.count_g * force.seconds
    return Velocity(
        velocity_mps=gravity.mps2 * velocity_gs,
        u_model_mps=gravity.mps2 * np.sqrt(squares),
        u_count_mps=gravity.mps2 * np.concatenate(([0.0], counted)),
        u_noise_mps=gravity.mps2 * PER_ROOT_2 * noise_g * np.sqrt(elapsed_s),
    )


def _charge(net_pulses: Array) -> Array:
    """Charge (m,) of intervals in pulses: that of the pulses, and half a pulse with the sign of the last at each end.

    An interval without pulses has the sign of the one before it.
    """
    sign = np.sign(net_pulses)
    fired = np.flatnonzero(np.abs(sign) == 1)
    if not len(fired):
        return net_pulses
    last = np.searchsorted(fired, np.arange(len(sign)), side="right") - 1
    at_end = sign[fired[np.maximum(last, 0)]]
    return np.asarray(net_pulses + np.diff(at_end, prepend=at_end[0]) / 2)


def _integral(values: Array, seconds: Array) -> Array:
    """Integral (m + 1,) of values that are constant in each interval (m,)."""
    return np.concatenate(([0.0], np.cumsum(values * seconds)))


@dataclass(frozen=True, slots=True)
class _Axis:
    """One channel with its curves at the temperature of each interval (m,).

    `raw` is (output - offset) / scale, `uncoupled_g` is that less the bias.
    """

    known: Compensation
    terms: ForceTerms
    held_c: Array
    outside: NDArray[np.bool_]
    scale: Array
    raw: Array
    uncoupled_g: Array

    @classmethod
    def of(cls, known: Compensation, output: Array, temperature_c: Array, beyond: Beyond) -> _Axis:
        """The axis of a channel with these mean outputs at these temperatures (m,). Raises ValueError without terms."""
        if known.force is None:
            raise ValueError(f"{known.channel} has no force terms")
        held_c, outside = known.held(temperature_c, beyond)
        scale = values_of(known.scale, held_c)
        offset, bias = (0.0 if each is None else values_of(each, held_c) for each in (known.offset, known.bias))
        raw = (output - offset) / scale
        return cls(known, known.force, held_c, outside, scale, raw, raw - bias)

    def force_g(self, own_g: Array, forces: Mapping[str, Array]) -> Array:
        """Next approximation from the last one of this axis and of all axes."""
        found = self.uncoupled_g - self.terms.quadratic.value * (own_g**2 - 1)
        for channel, cross in self.terms.cross.items():
            found = found - cross.value * forces[channel]
        return found

    def errors(self, own_g: Array, forces: Mapping[str, Array]) -> Iterator[Array]:
        """Effect of one standard uncertainty of each independent error on the specific force, (m,) each."""
        curves = self._curve_errors()
        quadratic = [(1 - own_g**2) * (self.terms.quadratic.u or 0.0)]
        if self.terms.correlation:
            yield from _independent([*curves, *quadratic], self.terms.correlation)
        else:
            yield from (each for each in (*curves, *quadratic) if each.any())
        for channel, cross in self.terms.cross.items():
            yield -(cross.u or 0.0) * forces[channel]
        if self.terms.bias_u_g:
            yield np.full_like(own_g, self.terms.bias_u_g)
        if self.terms.scale_u:
            yield self.terms.scale_u * self.raw

    def _curve_errors(self) -> list[Array]:
        """Effect of one standard uncertainty of each coefficient of scale, offset and bias, (m,) each."""
        gains = (
            (self.known.scale, -self.raw / self.scale),
            (self.known.offset, -1 / self.scale),
            (self.known.bias, -1.0),
        )
        return [gain * each for curve, gain in gains if curve is not None for each in _uncertain(curve, self.held_c)]


def _uncertain(curve: Curve, temperature_c: Array) -> list[Array]:
    """Effect of one standard uncertainty of each coefficient of a curve on its values (m,); knots have one error."""
    match curve:
        case TemperatureModel():
            part = (temperature_c - curve.centre) / curve.scale
            return [u * part**power for power, u in enumerate(curve.u or (0.0,) * len(curve.coefficients))]
        case KnotModel():
            return [np.interp(temperature_c, curve.knots_c, curve.u)]
        case Constant():
            return [np.full_like(temperature_c, curve.u or 0.0)]


def _independent(errors: Sequence[Array], correlation: Sequence[Sequence[float]]) -> Iterator[Array]:
    """Errors (m,) with a correlation matrix, as a sum of independent ones."""
    sizes, vectors = np.linalg.eigh(np.array(correlation))
    for size, vector in zip(sizes.tolist(), vectors.T.tolist(), strict=True):
        parts = [factor * np.sqrt(max(size, 0.0)) * error for factor, error in zip(vector, errors, strict=True)]
        yield np.asarray(sum(parts[1:], parts[0]))
