"""Specific force from the output of a channel, at all its levels and temperatures (equations 2.5, turned round).

    D = K1 [(1 + α ΔT) (a + K0 + K2 a²)] + β ΔT        a in local g, ΔT = T - T_ref

α and β are those of the line through the slopes of all levels, since a record passes through levels between them.
K1 follows from the rate at 1 g. At one level K1 cannot be separated from K0 and K2, so that these are stated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.channel.reduction.compared_levels import GRAVITY_REFERENCE, Level
from bench.metrology.calibration.force_terms import ForceTerms, Sample
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.least_squares import Array
from bench.metrology.results.curves import Constant, TemperatureModel
from bench.metrology.results.finding import Finding

VALUE_UNIT = "g"


@dataclass(frozen=True, slots=True)
class StatedAccelerometer:
    """Bias K0 (g) and quadratic term K2 (g/g²) of a channel at 1 g, with their standard uncertainties."""

    bias_g: float
    bias_u_g: float
    quadratic: float
    quadratic_u: float

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> StatedAccelerometer:
        """The values that the settings of the method state."""
        names = ("bias_g", "bias_u_g", "quadratic_g_per_g2", "quadratic_u_g_per_g2")
        return cls(*(settings[name] for name in names))


def to_specific_force(
    channel: str,
    levels: Mapping[str, Level],
    rate: Finding,
    coefficients: tuple[Finding, Finding],
    correlation: float,
    stated: StatedAccelerometer,
    reference_c: float,
    sampled: tuple[Sample, float] = ("", 0.0),
) -> Compensation:
    """Compensation of a channel to specific force; `sampled` is the kind of its samples and their step.

    `levels` are the usable ones with that at 1 g among them, `rate` is its rate, and `coefficients` are β and α with
    their uncertainties and the `correlation` of their errors.
    """
    up_g = levels[GRAVITY_REFERENCE].data.level.level_g
    beta, alpha = coefficients
    per_scale = up_g + stated.bias_g + stated.quadratic * up_g**2
    k1 = rate.value / per_scale
    # Columns: rate, K0, K2, α, β. Rows: coefficients of scale, of offset, bias with K2, K2.
    own = np.array([1 / per_scale, -k1 / per_scale, -k1 * up_g**2 / per_scale, 0, 0])
    jacobian = np.array([
        own, own * alpha.value + [0, 0, 0, k1, 0], np.zeros(5), [0, 0, 0, 0, 1], [0, 1, 1, 0, 0], [0, 0, 1, 0, 0],
    ])  # fmt: skip
    covariance = jacobian @ _covariance(rate, beta, alpha, correlation, stated) @ jacobian.T
    u = np.sqrt(np.diag(covariance))
    ends = [(float(np.min(c)), float(np.max(c))) for c in (level.run.gates.converter_c for level in levels.values())]
    valid_c = max(low for low, _ in ends), min(high for _, high in ends)
    curve = _curve_at(reference_c, rate.uut, valid_c)
    output_unit, scale_unit = rate.unit, f"{rate.unit}/{VALUE_UNIT}"
    reached_g = [0.0, *(level.data.level.level_g for level in levels.values())]
    return Compensation(
        channel, output_unit, VALUE_UNIT,
        scale=curve("scale", scale_unit, (k1, k1 * alpha.value), u[:2]),
        offset=curve("offset", output_unit, (0.0, beta.value), u[2:4]),
        bias=Constant(stated.bias_g + stated.quadratic, VALUE_UNIT, float(u[4])),
        serves=tuple(levels),
        force=ForceTerms(
            Constant(stated.quadratic, "g/g²", float(u[5])), (min(reached_g), max(reached_g)),
            correlation=tuple(tuple(row) for row in _correlation(covariance, u).tolist()),
            sample=sampled[0], step=sampled[1],
        ),
    )  # fmt: skip


def _covariance(rate: Finding, beta: Finding, alpha: Finding, of_drift: float, stated: StatedAccelerometer) -> Array:
    """Covariance of rate, K0, K2, α and β, with the correlation of the last two."""
    u = np.array([rate.u, stated.bias_u_g, stated.quadratic_u, alpha.u, beta.u])
    correlation = np.eye(5)
    correlation[3, 4] = correlation[4, 3] = of_drift
    return np.asarray(np.outer(u, u) * correlation)


def _correlation(covariance: Array, u: Array) -> Array:
    scale = np.where(u > 0, u, 1.0)
    found = covariance / np.outer(scale, scale)
    np.fill_diagonal(found, 1.0)
    return np.asarray(found)


def _curve_at(reference_c: float, uut: str, valid_c: tuple[float, float]) -> Any:
    def curve(what: str, unit: str, coefficients: tuple[float, float], u: Array) -> TemperatureModel:
        at_reference, slope = coefficients
        return TemperatureModel(
            id=what, uut=uut, quantity=what, unit=unit, centre=reference_c, scale=1.0,
            coefficients=coefficients, u=tuple(u.tolist()),
            powers_of_t=(at_reference - slope * reference_c, slope), valid_c=valid_c,
        )  # fmt: skip

    return curve
