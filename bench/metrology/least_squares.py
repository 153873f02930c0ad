"""The fitting kernel: linear least squares, polynomials, outliers, and the choice of a degree (equations 1.8).

A design matrix is scaled column by column and solved by its singular values. These also reveal coefficients that the
data do not determine: NotDetermined names them; nothing is set to zero silently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from bench.metrology.results.flag import NOT_DETERMINED, ONE_NOT_DETERMINED, Flag

Array = NDArray[np.float64]

CONDITION_LIMIT = 1e3
"""Of a column-scaled design matrix; a tumble has 2.4 to 20, a small-angle tumble with one unknown too many ≥ 1e4."""

OUTLIER_SIGMAS = 6.0
SIGMA_PER_MAD = 1.4826  # standard deviation / median absolute deviation of a normal distribution
EXCESSIVE_OUTLIERS = 0.1


class NotDetermined(ValueError):
    """The data do not determine the requested coefficients; `names` are those that cannot be separated.

    Results report it by the flag `ill_conditioned`, and with `note` as a remark.
    """

    def __init__(self, names: Sequence[str], *, rank: int, of: int, condition: float) -> None:
        self.names, self.rank, self.of, self.condition = tuple(names), rank, of, condition
        several = len(names) > 1
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if several else names[0]
        values = {"names": listed, "rank": rank, "count": of, "condition": f"{condition:.3g}"}
        self.note = Flag(NOT_DETERMINED if several else ONE_NOT_DETERMINED, values=values)
        super().__init__(str(self.note))


@dataclass(frozen=True, slots=True)
class LinearFit:
    """Least squares y = design @ coefficients.

    `gain` (p, n) is the sensitivity of each coefficient to each y. `unscaled_covariance` is (XᵀX)⁻¹: times the variance
    of one y, known from elsewhere, it is the covariance of the coefficients. `residual_sd` is NaN when there are no
    more readings than coefficients.
    """

    coefficients: Array
    gain: Array
    residuals: Array
    dof: int
    rank: int
    condition: float

    @property
    def unscaled_covariance(self) -> Array:
        """(XᵀX)⁻¹."""
        return self.gain @ self.gain.T

    @property
    def residual_sd(self) -> float:
        """Standard deviation of one reading, from the residuals; NaN without degrees of freedom."""
        return float(np.sqrt(np.sum(self.residuals**2) / self.dof)) if self.dof else np.nan

    @property
    def covariance(self) -> Array:
        """Covariance of the coefficients, type A, from the residuals of this fit."""
        return self.unscaled_covariance * self.residual_sd**2


def least_squares(
    design: Array, y: Array, *, names: Sequence[str] | None = None, condition_limit: float = CONDITION_LIMIT
) -> LinearFit:
    """Fit `y` (n,) by the design matrix `design` (n, p); `names` of the p coefficients are for the error.

    Raises NotDetermined when the column-scaled design has a rank below p or a condition number above the limit.
    """
    size = np.linalg.norm(design, axis=0)
    scale = np.where(size > 0, size, 1.0)
    left, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    columns = design.shape[1]
    largest = singular.max(initial=0.0)
    determined = singular > np.finfo(np.float64).eps * max(design.shape) * largest
    rank = int(np.sum(determined))
    condition = float(singular[0] / singular[-1]) if rank == columns else np.inf
    if condition > condition_limit:
        determined &= singular >= largest / condition_limit  # of several equal columns none represents the others
        raise NotDetermined(
            _undetermined(right[determined], names or [f"coefficient {i}" for i in range(columns)]),
            rank=rank, of=columns, condition=condition,
        )  # fmt: skip
    gain = right.T / singular / scale[:, np.newaxis] @ left.T
    coefficients = gain @ y
    coefficients += gain @ (y - design @ coefficients)  # removes most of the rounding error of the first
    return LinearFit(coefficients, gain, y - design @ coefficients, len(y) - columns, rank, condition)


def _undetermined(known: Array, names: Sequence[str]) -> list[str]:
    """Coefficients with a component outside the directions `known`, the rows of an orthonormal basis."""
    part = 1 - np.sum(known**2, axis=0)
    return [name for name, p in zip(names, part, strict=True) if p > 0.01]


@dataclass(frozen=True, slots=True)
class PolynomialFit:
    """A polynomial in z = (x - centre) / scale, well conditioned where powers of x are not.

    `coefficients` are those of the powers of z, low order first; `valid` is the range of x that was fitted.
    """

    centre: float
    scale: float
    fit: LinearFit
    valid: tuple[float, float]

    @property
    def coefficients(self) -> Array:
        """Coefficients of the powers of z, low order first."""
        return self.fit.coefficients

    @property
    def covariance(self) -> Array:
        """Covariance of `coefficients`."""
        return self.fit.covariance

    @property
    def u(self) -> Array:
        """Standard uncertainties of `coefficients`, type A."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of `coefficients`; it depends on where x was sampled, not on y."""
        u = np.sqrt(np.diag(self.fit.unscaled_covariance))
        return np.asarray(self.fit.unscaled_covariance / np.outer(u, u))

    @property
    def powers(self) -> Array:
        """Coefficients of the powers of x, low order first."""
        return self._z_to_x() @ self.coefficients

    @property
    def u_powers(self) -> Array:
        """Standard uncertainties of `powers`, type A."""
        to_x = self._z_to_x()
        return np.sqrt(np.diag(to_x @ self.covariance @ to_x.T))

    @property
    def degree(self) -> int:
        """The highest power."""
        return len(self.coefficients) - 1

    @property
    def residuals(self) -> Array:
        """Residuals, y minus the polynomial, in the order of the data."""
        return self.fit.residuals

    @property
    def residual_sd(self) -> float:
        """Standard deviation of one y, from the residuals; NaN without degrees of freedom."""
        return self.fit.residual_sd

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.fit.dof

    @property
    def max_residual(self) -> float:
        """Largest absolute residual."""
        return float(np.max(np.abs(self.fit.residuals)))

    def value(self, x: Array | float) -> Array:
        """The polynomial at `x`."""
        return np.asarray(polynomial.polyval(self._z(x), self.coefficients))

    def slope(self, x: Array | float) -> Array:
        """Derivative with respect to x at `x`."""
        return np.asarray(polynomial.polyval(self._z(x), polynomial.polyder(self.coefficients)) / self.scale)

    def _z(self, x: Array | float) -> Array:
        return (np.asarray(x, dtype=np.float64) - self.centre) / self.scale

    def _z_to_x(self) -> Array:
        """Matrix whose column k holds the coefficients of ((x - centre) / scale)^k in powers of x."""
        matrix = np.zeros((self.degree + 1, self.degree + 1))
        for power in range(self.degree + 1):
            matrix[: power + 1, power] = polynomial.polypow([-self.centre / self.scale, 1 / self.scale], power)
        return matrix


def fit_polynomial(x: Array, y: Array, degree: int) -> PolynomialFit:
    """Least-squares polynomial of `degree` through y (n,) over x (n,).

    Raises NotDetermined when x has no more than `degree` distinct values.
    """
    names = [f"power {power}" for power in range(degree + 1)]
    if not len(x):
        raise NotDetermined(names, rank=0, of=degree + 1, condition=np.inf)
    centre = float(np.mean(x))
    scale = float(np.max(np.abs(x - centre))) or 1.0
    design = np.asarray(polynomial.polyvander((x - centre) / scale, degree), dtype=np.float64)
    fit = least_squares(design, y, names=names, condition_limit=np.finfo(np.float64).max)
    return PolynomialFit(centre, scale, fit, (float(np.min(x)), float(np.max(x))))


def choose_degree(x: Array, y: Array, highest: int = 4) -> int:
    """Degree of 1..`highest` with the smallest corrected Akaike criterion.

    All degrees are compared at once: a chain of F-tests would stop at degree 1 on a curve without a square term but
    with a cubic one. 1 if there are too few readings to compare.
    """
    distinct = len(np.unique(x))
    candidates = [d for d in range(1, highest + 1) if d < distinct and d + 3 < len(y)]
    return min(candidates, key=lambda degree: _akaike(fit_polynomial(x, y, degree), y), default=1)


def _akaike(model: PolynomialFit, y: Array) -> float:
    """Akaike criterion with the correction for small samples; the noise variance is one of the parameters."""
    n, parameters = len(y), model.degree + 2
    rounding = (16 * np.finfo(np.float64).eps * float(np.max(np.abs(y)))) ** 2
    variance = max(float(np.mean(model.residuals**2)), rounding, np.finfo(np.float64).tiny)
    return float(n * np.log(variance) + 2 * parameters * n / (n - parameters - 1))


@dataclass(frozen=True, slots=True)
class GatedFit:
    """A fit without the outliers; `kept` (n,) masks the readings that were used."""

    fit: LinearFit
    kept: NDArray[np.bool_]

    @property
    def dropped(self) -> list[int]:
        """Mask of the readings that were left out."""
        return [int(i) for i in np.flatnonzero(~self.kept)]

    @property
    def excessive(self) -> bool:
        """True if so many were left out that the result is invalid."""
        return bool(np.mean(~self.kept) > EXCESSIVE_OUTLIERS)


def reject_outliers(
    design: Array,
    y: Array,
    *,
    sigmas: float = OUTLIER_SIGMAS,
    resolution: Array | float = 0.0,
    harmless: Array | float = 0.0,
) -> GatedFit:
    """Fit, and drop readings more than `sigmas` robust standard deviations off the median residual, until none is left.

    Then dropped readings within the band of the final fit are readmitted, once. `resolution` is the standard deviation
    of each y from counting: if most readings are the same count, the robust one is 0. `harmless` (p,) times the
    coefficients is a deviation that does not matter for the result: the residuals of readings with hardly any noise are
    rounding errors of different sizes, of which the larger ones are no outliers. Raises NotDetermined as
    `least_squares` does.
    """
    kept = np.ones(len(y), dtype=np.bool_)
    back = False  # true once readings dropped because of a worse one were readmitted
    while True:
        fit = least_squares(design[kept], y[kept])
        rounding = 64 * np.finfo(np.float64).eps * float(np.max(np.abs(y[kept]), initial=0.0))
        away = np.abs(y - design @ fit.coefficients - np.median(fit.residuals))
        sigma = np.maximum(SIGMA_PER_MAD * float(np.median(away[kept])), resolution)
        no_matter = float(np.linalg.norm(harmless * fit.coefficients))
        near = away <= np.maximum(sigmas * sigma, max(rounding, no_matter))
        if not near[kept].all():
            kept &= near
        elif back or near.sum() == kept.sum():
            return GatedFit(fit, kept)
        else:
            kept, back = near, True
