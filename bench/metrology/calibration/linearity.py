"""Non-linearity of a sensor over its range.

    x = v · (1 + e + a · sign v + q · v/F + c · (v/F)²)

x is the reading without its bias by the stated scale factor, v the true value, F the end of the range. For a gyro these
are the terms of equations 8.6, for an accelerometer the second-order one of 1.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.coverage import effective_dof

FORM = (
    "x = v · (1 + scale_error + asymmetry · sign v + quadratic · v/F + cubic · (v/F)²), x = (output - offset) / scale"
)
RELATIVE: Mapping[str, Callable[[Array], Array]] = {
    "scale_error": np.ones_like,
    "asymmetry": np.sign,
    "quadratic": lambda part: part,
    "cubic": lambda part: part**2,
}
"""Contribution of each coefficient to a reading, relative to it, as a function of v/F."""
DEPARTURE = "points: departure from the curve"
DEPARTURE_PROBABILITY = 0.05
ROUNDS = 8  # each iteration reduces the error of v by a factor of the size of the coefficients, some 1e-3
LEAST_U = 1e-12  # relative to full scale


@dataclass(frozen=True, slots=True)
class Linearity:
    """Known coefficients by their names in RELATIVE, and the range of v of their determination."""

    coefficients: Mapping[str, float]
    u: Mapping[str, float]
    correlation: tuple[tuple[float, ...], ...]
    full_scale: float
    valid: tuple[float, float]

    def relative(self, true: Array) -> Array:
        """Relative error of the readings of true values (n,)."""
        part = true / self.full_scale
        found = np.zeros_like(part)
        for name, value in self.coefficients.items():
            found += value * RELATIVE[name](part)
        return found

    def true(self, reading: Array) -> tuple[Array, NDArray[np.bool_]]:
        """True values (n,) of readings without bias, and which are out of range: there the error is that at the end."""
        true = reading
        for _ in range(ROUNDS):
            true = reading / (1 + self.relative(np.clip(true, *self.valid)))
        return true, np.asarray((true < self.valid[0]) | (true > self.valid[1]))

    def to_json(self) -> dict[str, Any]:
        """Content of a calibration file."""
        return {
            "form": FORM,
            "full_scale": self.full_scale,
            **{name: {"value": value, "unit": "1", "u": self.u[name]} for name, value in self.coefficients.items()},
            "correlation": [list(row) for row in self.correlation],
            "valid": list(self.valid),
        }


@dataclass(frozen=True, slots=True)
class LinearityPoint:
    """A reading without bias and the true value, in one unit; the lines are those of their difference.

    Lines of a common source are one error at all points, or one relative error of all true values; the others are
    independent.
    """

    reading: float
    true: float
    lines: Sequence[BudgetLine]


def fit_linearity(
    points: Sequence[LinearityPoint],
    terms: Sequence[str],
    full_scale: float,
    common: frozenset[str],
    in_proportion: frozenset[str] = frozenset(),
) -> tuple[Linearity, Mapping[str, list[BudgetLine]]] | None:
    """Fit the curve through points; return it with the lines of each coefficient; None without a point.

    An error of a source in `common` is the same at all points; in proportion it has the sign of the true value.

    Of `terms`, in order of importance, those that the points do not determine are left out.
    """
    usable = list(terms[: max(len(points) - 1, 1)])
    while points and usable:
        try:
            return _fitted(points, usable, full_scale, common, in_proportion)
        except NotDetermined as problem:
            usable.remove([name for name in usable if name in problem.names][-1])
    return None


def _fitted(
    points: Sequence[LinearityPoint],
    terms: Sequence[str],
    full_scale: float,
    common: frozenset[str],
    in_proportion: frozenset[str],
) -> tuple[Linearity, Mapping[str, list[BudgetLine]]]:
    true = np.array([point.true for point in points])
    error = np.array([point.reading for point in points]) - true
    every = {line.source: line for point in points for line in point.lines}
    by_source = {source: line for source, line in every.items() if line.type != "alias"}
    contained = [line for line in every.values() if line.type == "alias"]
    u_of = {source: _column(points, source) for source in by_source}
    u_of |= {source: u_of[source] * np.sign(true) for source in in_proportion & u_of.keys()}
    common |= in_proportion
    own_u = np.sqrt(np.sum([u_of[source] ** 2 for source in u_of if source not in common], axis=0))
    weight = 1 / np.maximum(own_u, LEAST_U * full_scale)
    design = np.column_stack([true * RELATIVE[name](true / full_scale) for name in terms])
    least_squares(design, error, names=terms)  # raises; weights do not separate terms
    fit = least_squares(
        design * weight[:, np.newaxis], error * weight, names=terms, condition_limit=np.finfo(np.float64).max
    )
    gain = fit.gain * weight
    # Sensitivity of each coefficient to each source: a column for each independent error.
    effects = {
        source: (gain @ u)[:, np.newaxis] if source in common else gain * u for source, u in u_of.items()
    }  # fmt: skip
    effects[DEPARTURE] = gain / weight * _excess(fit)
    covariance = np.sum([columns @ columns.T for columns in effects.values()], axis=0)
    u = np.sqrt(np.diag(covariance))
    scale = np.where(u > 0, u, 1.0)
    lines = {
        name: [
            _line(points, source, by_source.get(source), columns[row], fit.dof) for source, columns in effects.items()
        ]
        + contained
        for row, name in enumerate(terms)
    }
    found = Linearity(
        coefficients=dict(zip(terms, fit.coefficients.tolist(), strict=True)),
        u=dict(zip(terms, u.tolist(), strict=True)),
        correlation=tuple(tuple(row) for row in (covariance / np.outer(scale, scale)).tolist()),
        full_scale=full_scale,
        valid=(float(min(0.0, np.min(true))), float(max(0.0, np.max(true)))),
    )
    return found, lines


def _excess(fit: LinearFit) -> float:
    """Ratio of the scatter of points about the curve to their expected scatter; 0 if that is by chance."""
    chance = scipy.special.gammaincc(fit.dof / 2, float(np.sum(fit.residuals**2)) / 2) if fit.dof else 1.0  # chi²
    return float(np.sqrt(fit.residual_sd**2 - 1)) if chance < DEPARTURE_PROBABILITY else 0.0


def _column(points: Sequence[LinearityPoint], source: str) -> Array:
    """Standard uncertainty from a source at each point (n,)."""
    return np.array([math.fsum(line.u for line in point.lines if line.source == source) for point in points])


def _line(
    points: Sequence[LinearityPoint], source: str, line: BudgetLine | None, parts: Array, of_fit: int
) -> BudgetLine:
    """A source of a coefficient: one part, or one for each point with degrees of freedom combined as in G.4."""
    u = float(np.linalg.norm(parts))
    if line is None:
        return BudgetLine(source, "A", u, of_fit or None)
    dof = line.dof
    if len(parts) == len(points) > 1:
        dofs = [next((each.dof for each in point.lines if each.source == source), None) for point in points]
        dof = effective_dof(list(zip(parts.tolist(), dofs, strict=True)))
    return BudgetLine(source, line.type, u, dof, line.shared)
