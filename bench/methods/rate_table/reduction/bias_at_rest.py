"""Output of a unit on a table at rest: a straight line over time, and harmonics over the angle.

A tilt of the axis appears in the readings once a turn, a tilt that itself varies once a turn appears twice. Both cancel
over whole turns; fitted beside the bias they do not enter it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array, NotDetermined, least_squares
from bench.metrology.pooled_scatter import Scatter, pooled

OPPOSITE = 0.02  # rad from half a turn: such a pair of angles has a mean free of the first harmonic


@dataclass(frozen=True, slots=True)
class RestReading:
    """One reading: time, angle of the table, and the output with its type A standard uncertainty."""

    at_s: float
    angle_deg: float
    output: float
    u: float
    dof: int


@dataclass(frozen=True, slots=True)
class Rest:
    """Bias over time, in the unit of the output; `dof` of the scatter.

    `of_one_angle`: all readings are at one angle, and a tilt of the axis is contained in the bias.
    """

    value: float
    u: float
    drift_per_s: float
    middle_s: float
    dof: int
    of_one_angle: bool

    def change(self, at_s: float) -> float:
        """Difference of the bias at a time from its value in the middle."""
        return self.drift_per_s * (at_s - self.middle_s)


def fit_rest(readings: Sequence[RestReading], *, axis_wobbles: bool = False) -> Rest:
    """Fit the bias from readings; ValueError without any. With `axis_wobbles` the second harmonic is not part of it.

    The scatter is estimated from each reading and from the residuals of the fit: pooled, or from the residuals if these
    are significantly larger.
    """
    if not readings:
        raise ValueError("no reading at rest")
    at_s = np.array([reading.at_s for reading in readings])
    angle_deg = np.array([reading.angle_deg % 360 for reading in readings])
    output = np.array([reading.output for reading in readings])
    own = Scatter(float(np.sqrt(np.mean([each.u**2 for each in readings]))), sum(each.dof for each in readings))
    middle_s = float(np.mean(at_s))
    for columns in _designs(at_s - middle_s, np.radians(angle_deg), axis_wobbles=axis_wobbles):
        try:
            fit = least_squares(np.column_stack(list(columns.values())), output, names=list(columns))
        except NotDetermined:
            continue
        left = Scatter(fit.residual_sd, fit.dof)
        sd, dof = (pooled(left, own) or left) if fit.dof else own
        names = list(columns)
        drift = float(fit.coefficients[names.index("drift")]) / _span_s(at_s) if "drift" in names else 0.0
        u = sd * float(np.sqrt(fit.unscaled_covariance[0, 0]))
        return Rest(float(fit.coefficients[0]), u, drift, middle_s, dof, "cosine" not in names)
    raise AssertionError("readings do not determine their mean")


def _designs(since_s: Array, angle_rad: Array, *, axis_wobbles: bool) -> list[dict[str, Array]]:
    """Design matrices, from most to fewest terms."""
    one = {"bias": np.ones_like(since_s)}
    over_time = {"drift": since_s / _span_s(since_s)}
    once = _harmonic(1, angle_rad, "cosine", "sine")
    twice = _harmonic(2, angle_rad, "cosine of twice", "sine of twice")
    with_wobble = [one | over_time | once | twice] if axis_wobbles else []
    return [*with_wobble, one | over_time | once, one | once, one | over_time, one]


def _harmonic(order: int, angle_rad: Array, cosine: str, sine: str) -> dict[str, Array]:
    """Columns of a harmonic; angles that cover only one phase of it determine one column."""
    since = order * (angle_rad - angle_rad[0])
    if np.max(np.abs(np.sin(since))) < order * OPPOSITE:
        return {cosine: np.cos(since)}
    return {cosine: np.cos(order * angle_rad), sine: np.sin(order * angle_rad)}


def _span_s(at_s: Array) -> float:
    return float(np.ptp(at_s)) or 1.0
