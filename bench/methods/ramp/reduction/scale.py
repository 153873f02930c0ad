"""Scale factor over temperature, from the 0 g and the 1 g part of a ramp (equations 6.3: U90 - U0 gives K1).

The difference of the two readings is K1 times the difference of their specific forces. It contains K2, K3 and the
misalignment of the input axis too, which two positions do not separate from K1. Rising and falling temperature are
treated separately: at one indicated temperature the unit does not have the same temperature on both, nor its bias the
same history.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.ramp.reduction.samples import RampLeg
from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, fit_polynomial

DEGREE = 4  # degree of K0 and K1 over temperature in equations 6.2


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
