"""The scale factor over temperature, from the 0 g and the 1 g part of a ramp (methods.md 6.3: U90 - U0 gives K1).

The difference of the two readings is K1 times the difference of their specific forces. It holds K2, K3 and the
misalignment of the input axis too, which the two positions do not tell from K1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.fit import Array, PolynomialFit, fit_polynomial
from bench.analysis.ramp_samples import RampLeg

DEGREE = 4  # that of K0 and K1 over temperature in methods.md 6.2


@dataclass(frozen=True, slots=True)
class RampScale:
    """K1 in pulse/s/g over the temperature in °C: the polynomial, and the straight line through the same readings."""

    model: PolynomialFit
    line: PolynomialFit

    def at(self, temperature_c: Array) -> Array:
        """K1 at temperatures; beyond those it was measured at, that of the nearest."""
        return self.model.value(np.clip(temperature_c, *self.model.valid))

    def output_g(self, leg: RampLeg) -> Array:
        """What a leg read, less gravity at its angle: at 0 g the bias and the misalignment, which is constant."""
        return np.asarray(leg.rate_pps / self.at(leg.temperature_c) - np.sin(leg.angle_rad))


def scale_over_temperature(level: Sequence[RampLeg], upright: Sequence[RampLeg]) -> RampScale:
    """K1 of the legs of two angles; NotDetermined when a part has too few temperatures."""
    at_rest = _fitted([leg.temperature_c for leg in level], [leg.rate_pps for leg in level], DEGREE)
    temperatures = [leg.temperature_c for leg in upright]
    lifted_g = np.sin(upright[0].angle_rad) - np.sin(level[0].angle_rad)
    k1 = [(leg.rate_pps - at_rest.value(np.clip(leg.temperature_c, *at_rest.valid))) / lifted_g for leg in upright]
    return RampScale(_fitted(temperatures, k1, DEGREE), _fitted(temperatures, k1, 1))


def _fitted(temperatures_c: Sequence[Array], values: Sequence[Array], degree: int) -> PolynomialFit:
    x, y = np.concatenate(temperatures_c), np.concatenate(values)
    known = np.isfinite(x) & np.isfinite(y)
    return fit_polynomial(x[known], y[known], degree)
