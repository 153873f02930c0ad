"""Reduced temperature ramp of one unit: scale factor, and characteristic of the legs at 0 g (equations 6.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bench.methods.ramp.reduction.characteristic import Differences, DynamicCharacteristic, RampLimits, reduce_ramp
from bench.methods.ramp.reduction.legs import RampRecord
from bench.methods.ramp.reduction.samples import RampLeg
from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, fit_polynomial
from bench.metrology.thermometer_drift import DriftInRun

DEGREE = 4  # degree of K0 and K1 over temperature in equations 6.2


@dataclass(frozen=True, slots=True)
class ReducedRamp:
    """Legs of a unit at 0 g and at 1 g, scale factor over temperature, and characteristic of the legs at 0 g.

    The slope of the scale factor is of `whole` legs at 0 g and of those at 1 g, and so are `changes`; `level` and
    `found` are without turn-rounds.
    """

    level: Sequence[RampLeg]
    whole: Sequence[RampLeg]
    upright: Sequence[RampLeg]
    scale: RampScale
    found: DynamicCharacteristic
    changes: Sequence[Differences]
    limits: RampLimits

    @classmethod
    def of(cls, level: Sequence[RampLeg], upright: Sequence[RampLeg], limits: RampLimits) -> Self:
        """Reduce the legs at 0 g and at 1 g; NotDetermined if they have no direction or too few temperatures."""
        whole = scale_over_temperature(level, upright)
        at_0g, at_1g = ([leg.without_turns() for leg in part] for part in (level, upright))
        scale = replace(scale_over_temperature(at_0g, at_1g), line=whole.line)
        changes = reduce_ramp(_record(level, whole), limits, turns=True).changes
        found = reduce_ramp(_record(at_0g, scale), limits)
        return cls(at_0g, level, upright, scale, found, changes, limits)

    def drifted(self, drift: DriftInRun) -> ReducedRamp:
        """The same with a thermometer drift of one standard uncertainty added.

        Loops and changes between cycles use the same samples at each whole degree, with outputs corrected for the
        shifted temperatures: other samples would differ by their scatter.
        """
        warmer, moved = (
            self.of(change(self.whole, drift), change(self.upright, drift), self.limits) for change in (_warmer, _moved)
        )
        return replace(warmer, found=replace(warmer.found, loops=moved.found.loops, changes=moved.found.changes))

    def tilted(self, level_rad: Callable[[Array], Array]) -> ReducedRamp:
        """The same with the base tilted by this much more at bench times (n,)."""
        k1 = float(self.scale.line.coefficients[0])
        level, upright = (
            [replace(leg, output=leg.output - k1 * np.cos(leg.angle_rad) * level_rad(leg.time_s)) for leg in part]
            for part in (self.whole, self.upright)
        )
        return self.of(level, upright, self.limits)

    @property
    def per_g(self) -> float:
        """Acceleration in g for one unit of the output."""
        return 1 / abs(float(self.scale.line.coefficients[0]))

    @property
    def bias_slope(self) -> float:
        """Slope of the straight line of the bias, in g/°C."""
        return float(self.found.line.coefficients[1]) / self.found.line.scale

    @property
    def scale_slope(self) -> float:
        """Slope of the straight line of the scale factor, relative to its value at the centre, in 1/°C."""
        line = self.scale.line
        return float(line.coefficients[1] / line.coefficients[0]) / line.scale


def _warmer(legs: Sequence[RampLeg], drift: DriftInRun) -> list[RampLeg]:
    return [replace(leg, temperature_c=leg.temperature_c + drift.error_c(leg.time_s)) for leg in legs]


def _moved(legs: Sequence[RampLeg], drift: DriftInRun) -> list[RampLeg]:
    ways = {leg.direction for leg in legs}
    models = {way: over_temperature([leg for leg in legs if leg.direction == way]) for way in ways}
    moved = [models[leg.direction].slope(leg.temperature_c) * drift.error_c(leg.time_s) for leg in legs]
    return [replace(leg, output=leg.output - by) for leg, by in zip(legs, moved, strict=True)]


def _record(legs: Sequence[RampLeg], scale: RampScale) -> RampRecord:
    """The 0 g part as one record."""
    return RampRecord(
        cycle=_joined([np.full(len(leg.time_s), leg.cycle) for leg in legs]),
        leg=np.concatenate([np.full(len(leg.time_s), leg.name) for leg in legs]),
        time_s=_joined([leg.time_s for leg in legs]),
        temperature_c=_joined([leg.temperature_c for leg in legs]),
        output_g=_joined([scale.output_g(leg) for leg in legs]),
    )


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate(parts).astype(np.float64)


@dataclass(frozen=True, slots=True)
class RampScale:
    """K1 in pulse/s/g or V/g over the temperature in °C, by the direction of the temperature: 1 rising, -1 falling.

    `model` and `line` are the polynomial and the straight line through the readings of both. `left` is the relative
    root mean square of the residuals of the polynomials by direction: near a turn of the ramp, the unit is not as warm
    at an indicated temperature as half way.
    """

    by_direction: Mapping[int, PolynomialFit]
    model: PolynomialFit
    line: PolynomialFit
    left: float

    def output_g(self, leg: RampLeg) -> Array:
        """Output of a leg without gravity at its angle: at 0 g the bias and the misalignment, which is constant.

        Beyond the temperatures of the legs at 1 g, K1 is that of the nearest temperature.
        """
        k1 = _within(self.by_direction.get(leg.direction, self.model), leg.temperature_c)
        return np.asarray(leg.output / k1 - np.sin(leg.angle_rad))


def scale_over_temperature(level: Sequence[RampLeg], upright: Sequence[RampLeg]) -> RampScale:
    """K1 of the legs of two angles; NotDetermined if they have no direction in common, or too few temperatures."""
    lifted_g = np.sin(upright[0].angle_rad) - np.sin(level[0].angle_rad)
    by_direction, temperatures, scales = {}, [], []
    for direction in (1, -1):
        below = [leg for leg in level if leg.direction == direction]
        above = [leg for leg in upright if leg.direction == direction]
        if below and above:
            at_rest = over_temperature(below)
            temperature_c = np.concatenate([leg.temperature_c for leg in above])
            output = np.concatenate([leg.output for leg in above])
            k1 = (output - _within(at_rest, temperature_c)) / lifted_g
            by_direction[direction] = _fitted([temperature_c], [k1], DEGREE)
            temperatures.append(temperature_c)
            scales.append(k1)
    if not by_direction:
        raise NotDetermined(["K1"], rank=0, of=1, condition=np.inf)
    model = _fitted(temperatures, scales, DEGREE)
    left = np.concatenate([fit.residuals for fit in by_direction.values()]) / model.value(model.centre)
    return RampScale(by_direction, model, _fitted(temperatures, scales, 1), float(np.sqrt(np.mean(left**2))))


def over_temperature(legs: Sequence[RampLeg]) -> PolynomialFit:
    """Output of legs over their temperature, a polynomial of `DEGREE`."""
    return _fitted([leg.temperature_c for leg in legs], [leg.output for leg in legs], DEGREE)


def _within(fit: PolynomialFit, temperature_c: Array) -> Array:
    """Polynomial at temperatures; beyond its fitted range, its value at the nearest end."""
    return fit.value(np.clip(temperature_c, *fit.valid))


def _fitted(temperatures_c: Sequence[Array], values: Sequence[Array], degree: int) -> PolynomialFit:
    x, y = np.concatenate(temperatures_c), np.concatenate(values)
    known = np.isfinite(x) & np.isfinite(y)
    return fit_polynomial(x[known], y[known], degree)
