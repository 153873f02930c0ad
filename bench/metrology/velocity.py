"""Specific force and velocity from the output of calibrated channels, compensated for temperature (equations 2.5, 4.5).

The output is counted or sampled (`motion_records.py`). Errors of the calibration are the same throughout a record:
their effects on the specific force are integrated with their signs, and only then squared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Beyond, Compensation, Curve, values_of
from bench.metrology.least_squares import Array
from bench.metrology.motion_records import CountRecord, Record
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel
from bench.metrology.sampled_codes import hidden_by_steps

ROUNDS = 6  # each iteration reduces the error by a factor of the size of cross-coupling and nonlinearity, some 1e-3
PER_ROOT_12 = 12**-0.5  # standard uncertainty of a rectangular distribution over its width
PER_ROOT_2 = 0.5**0.5  # a one-sided density N gives a mean over t a standard deviation of N / sqrt(2 t)


@dataclass(frozen=True, slots=True)
class Gravity:
    """Local gravity of a calibration, its unit of specific force, and the standard uncertainty."""

    mps2: float
    u_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class SpecificForce:
    """Mean specific force (m,) in g along the axis of a channel in each interval between two readings.

    `errors` are the effects of one standard uncertainty of each independent error of the calibration on it, (m,) each.
    `count_g` (m,) is the specific force of one pulse in the interval, 0 for samples. `own_gs` (m,) is the standard
    uncertainty of the integral over the interval in g s that it has for itself: rounded and lost samples. `outside`
    (m,) masks temperatures out of range.
    """

    force_g: Array
    errors: tuple[Array, ...]
    count_g: Array
    own_gs: Array
    seconds: Array
    outside: NDArray[np.bool_]

    def u_g(self, noise_g: float = 0.0) -> Array:
        """Standard uncertainty (m,) of each value; `noise_g` is the density of white noise in g/√Hz."""
        squares = (RESOLUTION_COUNTS * self.count_g) ** 2 + (PER_ROOT_2 * noise_g) ** 2 / self.seconds
        squares += (self.own_gs / self.seconds) ** 2
        for error in self.errors:
            squares += error**2
        return np.sqrt(squares)

    def u_mps2(self, gravity: Gravity, noise_g: float = 0.0) -> Array:
        """The same in m/s²."""
        return np.hypot(gravity.mps2 * self.u_g(noise_g), gravity.u_mps2 * self.force_g)


@dataclass(frozen=True, slots=True)
class Velocity:
    """Integral (n,) in m/s of the specific force from the first reading to each, and its standard uncertainties (n,).

    `u_model_mps` is due to the calibration and gravity, `u_count_mps` to the fractions of a pulse at both ends or to
    rounded and lost samples, `u_noise_mps` to white noise.
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
    record: Record, channels: Mapping[str, Compensation], beyond: Beyond = "hold"
) -> dict[str, SpecificForce]:
    """Specific force along the axes of `channels`, whose compensations have force terms.

    `channels` contains the channels of their cross-coupling, and `record` all of them.
    """
    axes = {
        name: _Axis.of(known, record.output(name), record.output_c(name), beyond) for name, known in channels.items()
    }
    forces = {name: axis.uncoupled_g for name, axis in axes.items()}
    for _ in range(ROUNDS):
        forces = {name: axis.force_g(forces[name], forces) for name, axis in axes.items()}
    return {name: _over_intervals(record, axis, forces) for name, axis in axes.items()}


def _over_intervals(record: Record, axis: _Axis, forces: Mapping[str, Array]) -> SpecificForce:
    """Specific force of a channel in each interval from those of each output."""
    channel, seconds = axis.known.channel, np.diff(record.time_s)
    errors, count_g, own_gs = list(axis.errors(forces[channel], forces)), np.zeros_like(seconds), np.zeros_like(seconds)
    if isinstance(record, CountRecord):
        count_g = 1 / np.abs(axis.scale) / seconds
    else:
        step_g = axis.terms.step / np.abs(axis.scale)
        if axis.terms.step:
            errors.append(step_g * hidden_by_steps(record.scatter(channel), axis.terms.step) / axis.terms.step)
        bridged_gs = record.lost_s() * np.abs(np.diff(forces[channel]))
        own_gs = PER_ROOT_12 * np.hypot(record.mean(step_g) * seconds, bridged_gs)
    return SpecificForce(
        force_g=record.mean(forces[channel]),
        errors=tuple(record.mean(error) for error in errors),
        count_g=count_g,
        own_gs=own_gs,
        seconds=seconds,
        outside=record.any(axis.outside),
    )


def integrate(force: SpecificForce, gravity: Gravity, noise_g: float = 0.0) -> Velocity:
    """Integrate a specific force to velocity; `noise_g` is the density of white noise in g/√Hz."""
    velocity_gs = _integral(force.force_g, force.seconds)
    squares = (gravity.u_mps2 / gravity.mps2 * velocity_gs) ** 2
    for error in force.errors:
        squares += _integral(error, force.seconds) ** 2
    elapsed_s = _integral(np.ones_like(force.seconds), force.seconds)
    counted = RESOLUTION_COUNTS * force.count_g * force.seconds
    own = np.concatenate(([0.0], np.sqrt(np.cumsum(force.own_gs**2))))
    return Velocity(
        velocity_mps=gravity.mps2 * velocity_gs,
        u_model_mps=gravity.mps2 * np.sqrt(squares),
        u_count_mps=gravity.mps2 * np.hypot(np.concatenate(([0.0], counted)), own),
        u_noise_mps=gravity.mps2 * PER_ROOT_2 * noise_g * np.sqrt(elapsed_s),
    )


def _integral(values: Array, seconds: Array) -> Array:
    """Integral (m + 1,) of values that are constant in each interval (m,)."""
    return np.concatenate(([0.0], np.cumsum(values * seconds)))


@dataclass(frozen=True, slots=True)
class _Axis:
    """One channel with its curves at the temperature of each output (m,).

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
        """The axis of a channel with these outputs at these temperatures (m,). Raises ValueError without terms."""
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
