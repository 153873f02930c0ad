"""Trend of one result of a unit over its calibrations: differences, drift, and the day on which a limit is reached.

Calibrations at one bench share errors, such as that of the certificate of its head. They are the covariance of the
values, so that they neither hide a drift nor, after a new certificate, pretend one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bench.metrology.results.coverage import COVERAGE, coverage_factor

YEAR = timedelta(days=365.25)
MONTH = YEAR / 12
LEAST_SPAN = timedelta(days=1)  # of calibrations that show a drift
AHEAD_YEARS, STEPS_PER_YEAR = 10, 365
INCONSISTENT = 0.95  # quantile of the chi-squared distribution

Array = npt.NDArray[np.float64]


class Calibration(NamedTuple):
    """Value of a result at an instant, with its expanded uncertainty U.

    `shared` are standard uncertainties of errors by their identity: two calibrations with the same identity have the
    same error, with the same sign.
    """

    at: datetime
    value: float
    expanded: float
    shared: Mapping[str, float] = {}

    @property
    def u(self) -> float:
        """Half of U: a standard uncertainty whose factor 2 has the coverage of U, whatever its degrees of freedom."""
        return self.expanded / COVERAGE


class Drift(NamedTuple):
    """Straight line through calibrations: `value` at `at`, and its slope per year.

    `expanded` is the expanded uncertainty of the slope. `chi_squared` compares the residuals with the uncertainties, at
    `dof` degrees of freedom; `fits` is False if they are larger than these explain. The covariance of value and slope
    is then widened by the Birge ratio, and U has the factor of `dof`.
    """

    at: datetime
    value: float
    per_year: float
    expanded: float
    chi_squared: float
    dof: int
    fits: bool
    covariance: tuple[float, float, float]  # of the value; of value and slope; of the slope
    k: float = COVERAGE

    @property
    def is_significant(self) -> bool:
        """True if the drift is larger than its expanded uncertainty."""
        return abs(self.per_year) > self.expanded

    def predicted(self, at: datetime) -> tuple[float, float]:
        """Return the value of the line at an instant, and its expanded uncertainty."""
        values, expanded = self.after(np.array([(at - self.at) / YEAR]))
        return float(values[0]), float(expanded[0])

    def after(self, years: Array) -> tuple[Array, Array]:
        """Return values of the line some years after `at`, and their expanded uncertainties."""
        of_value, both, of_slope = self.covariance
        squared = of_value + 2.0 * years * both + years**2 * of_slope
        return self.value + years * self.per_year, self.k * np.sqrt(np.maximum(squared, 0.0))


def covariance(found: Sequence[Calibration]) -> Array:
    """Covariance matrix of the values: u² on the diagonal, and the products of the errors that two share beside it."""
    names = {name: place for place, name in enumerate(dict.fromkeys(name for each in found for name in each.shared))}
    errors = np.zeros((len(found), len(names)))
    for row, each in enumerate(found):
        errors[row, [names[name] for name in each.shared]] = list(each.shared.values())
    matrix: Array = errors @ errors.T
    np.fill_diagonal(matrix, [each.u**2 for each in found])
    return matrix


class Change(NamedTuple):
    """Change of a result between two calibrations, its U, and by how much it may change by a specification."""

    value: float
    expanded: float
    allowed: float

    @property
    def is_within(self) -> bool | None:
        """True or False if the change ± U is within the specification or beyond it; None if U reaches over it."""
        if abs(self.value) + self.expanded <= self.allowed:
            return True
        return False if abs(self.value) - self.expanded > self.allowed else None


def change(first: Calibration, second: Calibration, monthly: float) -> Change:
    """Change between two calibrations against a specified drift in a month.

    A shorter time counts as a month, in which the unit may change by the whole figure.
    """
    months = max(abs(second.at - first.at) / MONTH, 1.0)
    return Change(second.value - first.value, _expanded_of_difference(first, second), monthly * months)


def _expanded_of_difference(first: Calibration, second: Calibration) -> float:
    matrix = covariance((first, second))
    return COVERAGE * math.sqrt(max(float(matrix[0, 0] + matrix[1, 1] - 2.0 * matrix[0, 1]), 0.0))


def e_n(first: Calibration, second: Calibration) -> float | None:
    """E_n of two calibrations, with the sign of the change; None if their difference has no uncertainty.

    E_n = (x₂ - x₁) / U(x₂ - x₁), as in ISO 13528:2022, 9.7, where both are independent. Here
    u²(x₂ - x₁) = u₁² + u₂² - 2·cov(x₁, x₂) (JCGM 100:2008, equation 13), with the errors that both share in the
    covariance, and U = 2·u.
    """
    expanded = _expanded_of_difference(first, second)
    return (second.value - first.value) / expanded if expanded > 0.0 else None


def drift(found: Sequence[Calibration]) -> Drift | None:
    """Drift of calibrations by generalised least squares; None for fewer than two, or all within a day.

    x = a + b·(t - t₀) with the covariance V of the values: (a, b) = (XᵀV⁻¹X)⁻¹XᵀV⁻¹x, with the covariance (XᵀV⁻¹X)⁻¹,
    as in ISO/TS 28037:2010, clause 9; its test of consistency compares χ² = rᵀV⁻¹r with the 95 % quantile for n - 2
    degrees of freedom. t₀ is the last calibration. None as well if errors that all share are the whole uncertainty of
    some, so that V has no inverse.
    """
    from scipy.special import chdtri

    if len(found) < 2 or max(each.at for each in found) - min(each.at for each in found) < LEAST_SPAN:
        return None
    at = max(each.at for each in found)
    design = np.array([[1.0, (each.at - at) / YEAR] for each in found])
    values = np.array([each.value for each in found])
    scale = max(each.u for each in found)
    if not scale > 0.0:
        return None
    try:
        root = np.linalg.cholesky(covariance(found) / scale**2)
    except np.linalg.LinAlgError:
        return None
    whitened = np.linalg.solve(root, np.column_stack([design, values]))
    inverse = np.linalg.inv(whitened[:, :2].T @ whitened[:, :2])
    line = inverse @ whitened[:, :2].T @ whitened[:, 2]
    chi_squared = float(np.sum((whitened[:, 2] - whitened[:, :2] @ line) ** 2)) / scale**2
    dof = len(found) - 2
    fits = dof == 0 or chi_squared <= float(chdtri(dof, 1.0 - INCONSISTENT))
    widened = inverse * scale**2 * (1.0 if fits else chi_squared / dof)
    k = COVERAGE if fits else coverage_factor(dof)
    return Drift(
        at, float(line[0]), float(line[1]), k * math.sqrt(float(widened[1, 1])), chi_squared, dof, fits,
        (float(widened[0, 0]), float(widened[0, 1]), float(widened[1, 1])), k,
    )  # fmt: skip


def reaches_limit(found: Drift, low: float | None, high: float | None) -> datetime | None:
    """Return the first instant at which a limit is within the prediction ± its U; None if not within ten years.

    The control chart method of ILAC-G24:2022 for the interval of a calibration: it ends before the value can be outside
    its limits.
    """
    years = np.arange(AHEAD_YEARS * STEPS_PER_YEAR + 1) / STEPS_PER_YEAR
    values, expanded = found.after(years)
    beyond = np.zeros(len(years), bool)
    if low is not None:
        beyond |= values - expanded < low
    if high is not None:
        beyond |= values + expanded > high
    return found.at + float(years[np.argmax(beyond)]) * YEAR if beyond.any() else None
