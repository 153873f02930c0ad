"""Temperature coefficients of bias and scale factor about a reference temperature (equations 6.7).

They are the first terms of the model's own series there: K0(T) = K0 + K0T1 (T - Tref) + K0T2 (T - Tref)² + …, and K1(T)
= K1 [1 + K1T1 (T - Tref) + K1T2 (T - Tref)² + …]. For a model of the third degree or more they are local: T1 is its
slope at the reference temperature, T2 half of its second derivative there, and not the best parabola through all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from bench.metrology.least_squares import Array, PolynomialFit

HIGHEST = 2  # power of T - Tref that has a coefficient
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class TemperatureCoefficients:
    """T1 and T2 of a quantity: per °C and per °C², in the unit of the quantity or relative to it.

    `gain` (2, n) is the sensitivity of T1 and T2 to each fitted value. `covariance` (2, 2) is type A, from the
    residuals of the fit, NaN without degrees of freedom. T2 of a straight line is NaN. `extrapolated` is true if the
    reference temperature is outside the fitted range.
    """

    t1: float
    t2: float
    gain: Array
    covariance: Array
    extrapolated: bool

    @property
    def u(self) -> Array:
        """Standard uncertainties of T1 and T2, type A: (2,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float:
        """Correlation of T1 and T2; it follows from the temperatures, and needs no residuals."""
        (t1, both), (_, t2) = self.gain @ self.gain.T
        return float(both / np.sqrt(t1 * t2))


def bias_coefficients(bias: PolynomialFit, reference_c: float) -> TemperatureCoefficients:
    """K0T1 and K0T2, in the unit of the bias per °C and per °C². `bias` is at least a straight line."""
    series = _series(bias, reference_c)
    _, t1, t2 = series @ bias.coefficients
    return _coefficients(bias, reference_c, (t1, t2), series[1:])


def scale_coefficients(scale: PolynomialFit, reference_c: float) -> TemperatureCoefficients:
    """K1T1 and K1T2, relative to K1 at the reference temperature. `scale` is at least a straight line, and not 0."""
    series = _series(scale, reference_c)
    k1, *slopes = series @ scale.coefficients
    t1, t2 = np.array(slopes) / k1
    jacobian = (series[1:] - np.outer((t1, t2), series[0])) / k1
    return _coefficients(scale, reference_c, (t1, t2), jacobian)


def _series(model: PolynomialFit, reference_c: float) -> Array:
    """Matrix (3, p) from the coefficients (p,) of a model to those of the powers 0 to 2 of T - reference."""
    z = (reference_c - model.centre) / model.scale
    series = np.zeros((HIGHEST + 1, model.degree + 1))
    for power in range(min(HIGHEST, model.degree) + 1):
        shifted = [comb(k, power) * z ** max(k - power, 0) for k in range(model.degree + 1)]  # of (z + d)^k, at d^power
        series[power] = np.array(shifted) / model.scale**power
    return series


def _coefficients(model: PolynomialFit, reference_c: float, values: Pair, jacobian: Array) -> TemperatureCoefficients:
    """T1 and T2 (2,), with their derivatives with respect to the coefficients of the model, (2, p)."""
    low_c, high_c = model.valid
    known = np.array([1.0, 1.0 if model.degree >= HIGHEST else np.nan])
    jacobian = jacobian * known[:, np.newaxis]
    return TemperatureCoefficients(
        t1=float(values[0]),
        t2=float(values[1] * known[1]),
        gain=jacobian @ model.fit.gain,
        covariance=jacobian @ model.covariance @ jacobian.T,
        extrapolated=not low_c <= reference_c <= high_c,
    )
