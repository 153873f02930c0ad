"""Both ends of a unit together: bias and scale factor free of misalignment and cross coupling (equations 3.4).

Over small angles the output at the end with the sign s is U = c0 + c1 sin θ + s c1 δ cos θ + s c_xz sin θ cos θ. Its
line has b = c0 + s c1 δ c̄ and G = c1 + s c_xz k̄, with c̄ and k̄ about 1, so that the means of both ends are those of
the unit and the differences give δ and c_xz. Angles that are not symmetric, or not the same at both ends, mix the four
coefficients: they are separated by linear equations, of which this is the special case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from bench.methods.indexing.reduction.sweep import EndFit
from bench.metrology.least_squares import CONDITION_LIMIT, Array, least_squares
from bench.metrology.propagation import Estimate, Measured, inputs, weighted

ON_AXIS = 0.01  # |sin ψ| of a unit rotated by 0° or 180° only
Decision = Literal["accept", "repeat", "marginal"]


@dataclass(frozen=True, slots=True)
class Clocking:
    """Output at table angle 0 against the angle ψ of the unit on its seat: U = m + p cos ψ + q sin ψ, in V.

    `q_v` is None if only ψ = 0° and 180° were measured. `u_per_reading` is u(p) for readings with u = 1 V, and `gain`
    (n,) the sensitivity of p to each reading.
    """

    p_v: float
    q_v: float | None
    u_per_reading: float
    gain: Array = field(default_factory=lambda: np.zeros(0))


def fit_clocking(psi_rad: Array, output_v: Array) -> Clocking:
    """Fit readings (n,) at angles (n,). Raises NotDetermined if the angles do not suffice."""
    columns = [np.ones_like(psi_rad), np.cos(psi_rad), np.sin(psi_rad)]
    names = ["mean", "cos ψ", "sin ψ"]
    if np.all(np.abs(columns[2]) < ON_AXIS):
        del columns[2], names[2]
    fit = least_squares(np.stack(columns, axis=-1), output_v, names=names)
    q_v = float(fit.coefficients[2]) if len(names) > 2 else None
    return Clocking(float(fit.coefficients[1]), q_v, float(np.sqrt(fit.unscaled_covariance[1, 1])), fit.gain[1])


@dataclass(frozen=True, slots=True)
class Mounting:
    """Tilts of the mounted unit; None if not measured.

    `installation_rad` is φ3, the residual angle of the installation, `platform_rad` φ4, that between the table's
    horizontal and the platform. Tilts are positive if they raise the input axis.
    """

    installation_rad: Measured | None = None
    platform_rad: Measured | None = None
    seat: Clocking | None = None


@dataclass(frozen=True, slots=True)
class Agreement:
    """Criterion for equal scale factors of both ends.

    They may differ by `relative` of their mean or by `k` standard uncertainties, whichever is more. A calibration that
    has been repeated `most_repeats` times and still differs is marginal: the difference is the cross coupling.
    """

    relative: float = 0.0
    k: float = 2.0
    repeats: int = 0
    most_repeats: int = 3

    def judge(self, difference: Measured, scale: float) -> Decision:
        """Decide whether to accept a difference between the ends, in the unit of `scale`."""
        if abs(difference.value) <= max(self.relative * abs(scale), self.k * difference.u):
            return "accept"
        return "repeat" if self.repeats < self.most_repeats else "marginal"


@dataclass(frozen=True, slots=True)
class BothEnds:
    """Results of both ends as functions of their inputs; `scale` in the unit of the output per g, others in that unit.

    `tilted` is K1 times the misalignment; it and the cross coupling are None where the angles do not determine them.
    `seat` is the whole effect of the tilt of the seat on the output, by the clocking, b3 and b4 within it; None without
    a clocking. `known` is b3 + b4.
    """

    bias: Estimate
    scale: Estimate
    tilted: Estimate | None
    coupling: Estimate | None
    seat: Estimate | None
    known: Estimate

    @property
    def tilt(self) -> Estimate:
        """Effect of the tilt of the seat: by the clocking if there is one, else b3 + b4."""
        return self.known if self.seat is None else self.seat

    @property
    def beyond(self) -> Estimate | None:
        """b5: effect of the tilt beyond b3 and b4, by the clocking; None without a clocking."""
        return None if self.seat is None else self.seat - self.known

    @property
    def corrected(self) -> Estimate:
        """The bias without any tilt: b - (b3 + b4 + b5)."""
        return self.bias - self.tilt

    @property
    def total(self) -> Estimate:
        """Sum b + b3 + b4 + b5."""
        return self.bias + self.tilt


@dataclass(frozen=True, slots=True)
class TwoEnds:
    """Results of both ends, in V and V/g; None if undetermined, or if the mounting was not measured.

    Differences are up minus down. `beyond_v` is b5, the effect of the tilt beyond b3 and b4. `bias_total_v` is the bias
    plus the terms of the mounting, `bias_corrected_v` the bias minus these terms.
    """

    scale_v_per_g: Measured
    bias_v: Measured
    scale_difference_v_per_g: Measured
    bias_difference_v: Measured
    misalignment_rad: Measured | None
    coupling_v_per_g2: Measured | None
    installation_v: Measured | None
    platform_v: Measured | None
    beyond_v: Measured | None
    bias_total_v: Measured
    bias_corrected_v: Measured
    surface_tilt_rad: float | None


def combine(up: EndFit, down: EndFit, mounting: Mounting) -> TwoEnds:
    """Bias, scale factor, misalignment and cross coupling from the lines of both ends."""
    values, covariance = _inputs(up, down, mounting)
    *lines, installation, platform, seat = inputs(values)
    b_up, g_up, b_down, g_down = lines
    b, g, tilted, coupling = separate_coefficients(lines, up, down)
    b3, b4 = g * installation.sine(), g * platform.sine()  # an input that was not measured is 0
    both = BothEnds(b, g, tilted, coupling, seat if mounting.seat else None, b3 + b4)
    return TwoEnds(
        scale_v_per_g=g.measured(covariance),
        bias_v=b.measured(covariance),
        scale_difference_v_per_g=(g_up - g_down).measured(covariance),
        bias_difference_v=(b_up - b_down).measured(covariance),
        misalignment_rad=(tilted / g).measured(covariance) if tilted else None,
        coupling_v_per_g2=coupling.measured(covariance) if coupling else None,
        installation_v=b3.measured(covariance) if mounting.installation_rad else None,
        platform_v=b4.measured(covariance) if mounting.platform_rad else None,
        beyond_v=both.beyond.measured(covariance) if both.beyond else None,
        bias_total_v=both.total.measured(covariance),
        bias_corrected_v=both.corrected.measured(covariance),
        surface_tilt_rad=_surface_tilt(mounting.seat, g.value),
    )


def separate_coefficients(
    lines: Sequence[Estimate], up: EndFit, down: EndFit
) -> tuple[Estimate, Estimate, Estimate | None, Estimate | None]:
    """Separate c0, c1, c1 δ and c_xz from b and G up, b and G down.

    Over a whole turn the lines do not depend on δ and c_xz: these are None, and the means are c0 and c1.
    """
    mixed = np.block([[np.eye(2), up.factors], [np.eye(2), -down.factors]])
    if np.linalg.cond(mixed) > CONDITION_LIMIT:
        return (lines[0] + lines[2]) * 0.5, (lines[1] + lines[3]) * 0.5, None, None
    c0, c1, tilted, coupling = (weighted(row, lines) for row in np.linalg.inv(mixed))
    return c0, c1, tilted, coupling


def _inputs(up: EndFit, down: EndFit, mounting: Mounting) -> tuple[Array, Array]:
    """Values (7,) and covariance (7, 7) of b and G up, b and G down, φ3, φ4 and p of the seat.

    The few readings of the seat have the uncertainty of those of the sweeps.
    """
    angles = [angle or Measured(0.0, 0.0) for angle in (mounting.installation_rad, mounting.platform_rad)]
    seat = mounting.seat or Clocking(0.0, None, 0.0)
    reading_variance = (up.reading_sd_v**2 + down.reading_sd_v**2) / 2
    values = [up.bias_v, up.scale_v_per_g, down.bias_v, down.scale_v_per_g, *(a.value for a in angles), seat.p_v]
    variances = [*(angle.u**2 for angle in angles), seat.u_per_reading**2 * reading_variance]
    return np.array(values), block_diag(up.covariance, down.covariance, np.diag(variances))


def _surface_tilt(seat: Clocking | None, scale_v_per_g: float) -> float | None:
    if seat is None or seat.q_v is None:
        return None
    return float(np.hypot(seat.p_v, seat.q_v) / abs(scale_v_per_g))
