"""What a conversion of the output leaves on the legs of a ramp, of bias and of scale factor (equations 6.3, 6.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bench.methods.ramp.reduction.characteristic import rates_of
from bench.methods.ramp.reduction.legs import Leg, RampRecord, cut_into_legs
from bench.methods.ramp.reduction.reduced import DEGREE
from bench.methods.ramp.reduction.samples import RampLeg
from bench.methods.ramp.reduction.scatter import COUNT_STRIDE, resolution_u, shown_scatter
from bench.metrology.calibration.temperature import Compensation, values_of
from bench.metrology.extremes import scatter_sd
from bench.metrology.least_squares import Array, NotDetermined, fit_polynomial
from bench.metrology.tilt_pair import CONSTANT, DYNAMIC, STATIC


def _none(at_s: Array, _at_c: Array) -> Array:
    return np.zeros(len(at_s))


@dataclass(frozen=True)
class LeftErrors:
    """Errors added to the readings at times and temperatures (n,): of the thermometer in °C, of the level in rad."""

    thermometer_c: Callable[[Array, Array], Array] = _none
    level_rad: Callable[[Array, Array], Array] = _none
    factor: float = 1.0

    def times(self, factor: float) -> LeftErrors:
        """The same errors, `factor` times as large."""
        return replace(self, factor=factor)

    def read_c(self, leg: Leg) -> Array:
        """Temperatures (n,) of a leg with the error of the thermometer."""
        return leg.temperature_c + self.factor * self.thermometer_c(leg.time_s, leg.temperature_c)

    def lifted_g(self, leg: Leg, angle_rad: float) -> Array:
        """Specific force (n,) by the error of the level."""
        return np.asarray(self.factor * np.cos(angle_rad) * self.level_rad(leg.time_s, leg.temperature_c))


@dataclass(frozen=True)
class PartOfRamp:
    """Samples of the legs at one angle that are used: those without a turn-round, where dT/dt is known.

    `legs` have the output in its unit, `rates_c_per_s` dT/dt (n,) of each; `resolution_u` is the standard uncertainty
    of a counted output by the fractions of a pulse at both ends of a sample. `excluded` counts broken readings of the
    thermometer.
    """

    angle_rad: float
    legs: tuple[Leg, ...]
    rates_c_per_s: tuple[Array, ...]
    resolution_u: float
    excluded: int

    @classmethod
    def of(cls, legs: Sequence[RampLeg]) -> PartOfRamp:
        """Usable samples of whole legs."""
        record = RampRecord(  # outputs in the unit of the unit: a leg is cut by its temperature
            cycle=np.concatenate([np.full(len(leg.time_s), leg.cycle) for leg in legs]),
            leg=np.concatenate([np.full(len(leg.time_s), leg.name) for leg in legs]),
            time_s=np.concatenate([leg.time_s for leg in legs]),
            temperature_c=np.concatenate([leg.temperature_c for leg in legs]),
            output_g=np.concatenate([leg.output for leg in legs]),
        )
        whole, excluded = cut_into_legs(record)
        rates = [rates_of(leg) for leg in whole]
        pairs = [
            (_rows(leg, np.isfinite(rate)), rate[np.isfinite(rate)]) for leg, rate in zip(whole, rates, strict=True)
        ]
        used = [pair for pair in pairs if len(pair[1])]
        return cls(
            legs[0].angle_rad, tuple(leg for leg, _ in used), tuple(rate for _, rate in used), resolution_u(legs),
            excluded["thermometer"],
        )  # fmt: skip


def _rows(leg: Leg, rows: Array) -> Leg:
    """Some samples of a leg."""
    return replace(leg, time_s=leg.time_s[rows], temperature_c=leg.temperature_c[rows], output_g=leg.output_g[rows])


@dataclass(frozen=True)
class Left:
    """Converted output less gravity along the input axis by leg at 0 g, (n,) each in g.

    `static` by the curves of the calibration, `dynamic` by its dynamic model, equal without one; `uncompensated` has
    its scale factor and a constant bias. `scale` is the relative scale factor that is left, by leg at 1 g. `bias_left`
    is the root mean square, in g, of what the bias at 0 g has beside its polynomials by direction.
    """

    static: tuple[Array, ...]
    dynamic: tuple[Array, ...]
    uncompensated: tuple[Array, ...]
    scale: tuple[Array, ...]
    bias_left: float


@dataclass(frozen=True)
class LeftOnRamp:
    """Parts of a ramp of one unit, and the conversion `known` of its output; `gravity` is local g in its g."""

    level: PartOfRamp
    upright: PartOfRamp
    known: Compensation
    gravity: float

    @property
    def lifted_g(self) -> float:
        """Change of gravity along the input axis from the 0 g part to the 1 g part."""
        return float(np.sin(self.upright.angle_rad) - np.sin(self.level.angle_rad))

    def resolution_g(self, part: PartOfRamp) -> float:
        """Standard uncertainty of a converted output by the resolution of the count."""
        middle_c = np.array([float(np.median(np.concatenate([leg.temperature_c for leg in part.legs])))])
        return part.resolution_u / float(np.abs(values_of(self.known.scale, middle_c)[0]))

    @cached_property
    def is_extrapolated(self) -> bool:
        """True if a sample is outside of the temperatures of the calibration."""
        legs = (*self.level.legs, *self.upright.legs)
        return any(bool(self.known.held(leg.temperature_c, "hold")[1].any()) for leg in legs)

    @property
    def is_faster(self) -> bool:
        """True if the temperature changed faster than in the run of the dynamic model."""
        dynamic = self.known.dynamic
        return dynamic is not None and any(bool(dynamic.is_beyond(rate).any()) for rate in self.level.rates_c_per_s)

    def scatter_u(self, records: Sequence[Array], part: PartOfRamp) -> float:
        """Standard deviation of a sample about a smooth curve, from records of what is left on the legs of a part."""
        found = scatter_sd(records, COUNT_STRIDE)
        own = found if np.isfinite(found) else float(np.std(np.concatenate(records)))
        return shown_scatter(own, self.resolution_g(part))

    @cached_property
    def scatter_g(self) -> float:
        """Standard deviation of a converted output at 0 g."""
        static = [self._left_g(leg, self.level.angle_rad, LeftErrors()) for leg in self.level.legs]
        return self.scatter_u(static, self.level)

    def forces_g(self, part: PartOfRamp, index: int, errors: LeftErrors) -> dict[str, Array]:
        """Specific force (n,) on one leg, in the g of the calibration: by constants, static and dynamic.

        The constants are those of the calibration at the mean temperature of the run.
        """
        leg, rate = part.legs[index], part.rates_c_per_s[index]
        at_c = errors.read_c(leg)
        mean_c = np.full(len(at_c), np.mean(np.concatenate([each.temperature_c for each in self.level.legs])))
        static = self.known.apply(leg.output_g, at_c)[0]
        return {
            CONSTANT: self.known.apply(leg.output_g, mean_c)[0],
            STATIC: static,
            DYNAMIC: static - self.known.dynamic_less_static(at_c, rate),
        }

    def left(self, errors: LeftErrors) -> Left:
        """What is left with errors added to the readings; NotDetermined if the legs have no direction in common."""
        static = [self._left_g(leg, self.level.angle_rad, errors) for leg in self.level.legs]
        read_c = [errors.read_c(leg) for leg in self.level.legs]
        scale, bias_left = self._scale(static, errors)
        dynamic = [
            left - self.known.dynamic_less_static(at_c, rate)
            for left, at_c, rate in zip(static, read_c, self.level.rates_c_per_s, strict=True)
        ]
        uncompensated = [left + self._bias_g(at_c) for left, at_c in zip(static, read_c, strict=True)]
        return Left(tuple(static), tuple(dynamic), tuple(uncompensated), tuple(scale), bias_left)

    def _left_g(self, leg: Leg, angle_rad: float, errors: LeftErrors) -> Array:
        """Converted output (n,) of a leg less gravity along the nominal input axis."""
        value = self.known.apply(leg.output_g, errors.read_c(leg))[0]
        return np.asarray(value - self.gravity * np.sin(angle_rad) + errors.lifted_g(leg, angle_rad))

    def _bias_g(self, at_c: Array) -> Array:
        bias = self.known.bias
        return np.zeros(len(at_c)) if bias is None else values_of(bias, self.known.held(at_c, "hold")[0])

    def _scale(self, static: Sequence[Array], errors: LeftErrors) -> tuple[list[Array], float]:
        """Relative scale factor that is left on each leg at 1 g, and what the polynomials of the bias leave.

        The bias at a temperature is that of the legs at 0 g in the same direction.
        """
        if not self.level.legs or not self.upright.legs:
            raise NotDetermined(["K0"], rank=0, of=1, condition=np.inf)
        at_rest = {}
        for name in {leg.name for leg in self.level.legs}:
            pairs = [(leg, left) for leg, left in zip(self.level.legs, static, strict=True) if leg.name == name]
            at_c = np.concatenate([errors.read_c(leg) for leg, _ in pairs])
            at_rest[name] = fit_polynomial(at_c, np.concatenate([left for _, left in pairs]), DEGREE)
        if not all(leg.name in at_rest for leg in self.upright.legs):
            raise NotDetermined(["K1"], rank=0, of=1, condition=np.inf)
        scale = []
        for leg in self.upright.legs:
            fit = at_rest[leg.name]
            bias_g = fit.value(np.clip(errors.read_c(leg), *fit.valid))
            left_g = self._left_g(leg, self.upright.angle_rad, errors) - bias_g
            scale.append(left_g / (self.gravity * self.lifted_g))
        residuals = np.concatenate([fit.residuals for fit in at_rest.values()])
        return scale, float(np.sqrt(np.mean(residuals**2)))
