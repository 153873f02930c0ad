"""Least squares over the 24 attitudes of a set point: bias, nonlinearity, misalignment, g-sensitivity (equations 4.4).

All channels were read in all attitudes. This separates terms confounded in the eight attitudes of one axis: K2 from the
bias of an accelerometer, g-sensitivity from the zero of a gyro; it also gives the misalignments. K3 remains in K1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

import numpy as np

from bench.methods.imu.reduction.attitudes import SPECIFIC_FORCE_G, earth_rate_dps
from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares
from bench.metrology.run_data import AXES

Given = ParamSpec("Given")
Fit = TypeVar("Fit")


@dataclass(frozen=True, slots=True)
class AccelerometerFit:
    """N/t = K1 (K0 + f_a + m_b f_b + m_c f_c + K2 f_a²) of the channel `axis`; f in local g."""

    axis: int
    fit: LinearFit

    @property
    def k1_per_g(self) -> float:
        """Scale factor, with K3 in it."""
        return float(self._k1)

    @property
    def k0_g(self) -> float:
        """Bias, without K2."""
        return float(self.fit.coefficients[0] / self._k1)

    @property
    def k2_g_per_g2(self) -> float:
        """Second-order nonlinearity, with a converter's asymmetry in it."""
        return float(self.fit.coefficients[4] / self._k1)

    @property
    def misalignment_rad(self) -> Array:
        """Sensitivity of the input axis to x, y and z: (3,), 0 for its own axis."""
        return np.where(np.arange(3) == self.axis, 0.0, self.fit.coefficients[1:4] / self._k1)

    @property
    def weights(self) -> Array:
        """Sensitivities of K0, K1, K2 and the misalignments x, y and z to each reading used: (6, n)."""
        own = 1 + self.axis
        ratios = (0, 4, 1, 2, 3)
        jacobian = np.zeros((6, 5))
        for row, column in zip((0, 2, 3, 4, 5), ratios, strict=True):
            jacobian[row, column] = 1 / self._k1
            jacobian[row, own] -= self.fit.coefficients[column] / self._k1**2
        jacobian[2 + own] = 0  # an axis has no misalignment with itself
        jacobian[1, own] = 1
        return np.asarray(jacobian @ self.fit.gain)

    @property
    def u(self) -> Array:
        """Standard uncertainties, type A, of K0, K1, K2, and the misalignments x, y and z: (6,)."""
        return np.asarray(self.fit.residual_sd * np.linalg.norm(self.weights, axis=-1))

    @property
    def _k1(self) -> np.float64:
        return np.float64(self.fit.coefficients[1 + self.axis])


@dataclass(frozen=True, slots=True)
class GyroFit:
    """Zero in pulse/s and sensitivity to x, y and z in pulse/s/g (3,), NaN if not determined; u is type A.

    `weights` (4, n) are the sensitivities of zero and g-sensitivities to each reading used. `squares` is the sum of
    squared residuals, `dof` their degrees of freedom.
    """

    d0: float
    g_sensitivity_per_g: Array
    u_d0: float
    u_g_sensitivity_per_g: Array
    weights: Array
    squares: float
    dof: int


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def fit_accelerometer(output: Array, axis: int) -> AccelerometerFit:
    """Fit the readings (24,) in pulse/s of the channel `axis`, NaN if missing.

    Raises NotDetermined if too many are missing.
    """
    there = np.isfinite(output)
    force_g = SPECIFIC_FORCE_G[there]
    design = np.column_stack([np.ones(len(force_g)), force_g, force_g[:, axis] ** 2])
    names = [f"K0 of acc_{AXES[axis]}", *_by_axis("K1", "misalignment", axis), "K2"]
    return AccelerometerFit(axis, least_squares(design, output[there], names=names))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def fit_gyro(output: Array, axis: int, latitude_deg: float) -> GyroFit:
    """Fit the readings (24,) in pulse/s of the channel `axis`, NaN if missing.

    W/t = D0 + KG (w_a + m_b w_b + m_c w_c) + g_x f_x + g_y f_y + g_z f_z, w the earth rate.

    Raises NotDetermined if too many are missing, or near a pole, where headings carry no information.
    """
    there = np.isfinite(output)
    rate_dps, force_g = earth_rate_dps(latitude_deg)[there], SPECIFIC_FORCE_G[there]
    design = np.column_stack([np.ones(len(force_g)), force_g, rate_dps])
    names = [f"D0 of gyro_{AXES[axis]}", *_g_sensitivities(), *_by_axis("KG", "misalignment", axis)]
    return _gyro(least_squares(design, output[there], names=names), 3 * [True])


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def fit_gyro_of_known_scale(output: Array, axis: int, latitude_deg: float, pulse_per_deg: float) -> GyroFit:
    """The same near a pole, with KG from the rates.

    There the earth rate is vertical, as gravity is: with KG the sensitivity along the gyro's own axis is determined;
    along the others it stays together with the misalignments and is NaN.

    Raises NotDetermined when too many readings are missing.
    """
    turning_output = pulse_per_deg * earth_rate_dps(latitude_deg)[:, axis]
    there = np.isfinite(output - turning_output)
    force_g = SPECIFIC_FORCE_G[there]
    design = np.column_stack([np.ones(len(force_g)), force_g])
    names = [f"D0 of gyro_{AXES[axis]}", *_g_sensitivities()]
    fit = least_squares(design, (output - turning_output)[there], names=names)
    return _gyro(fit, [other == axis for other in range(len(AXES))])


def _gyro(fit: LinearFit, known: list[bool]) -> GyroFit:
    """Fit of a gyro from the first four coefficients; sensitivities that are not `known` are NaN."""
    u = fit.residual_sd * np.linalg.norm(fit.gain, axis=-1)
    sensitivity, u_sensitivity = (np.where(known, values[1:4], math.nan) for values in (fit.coefficients, u))
    squares = float(np.sum(fit.residuals**2))
    return GyroFit(float(fit.coefficients[0]), sensitivity, float(u[0]), u_sensitivity, fit.gain[:4], squares, fit.dof)


def _g_sensitivities() -> list[str]:
    return [f"g-sensitivity {name}" for name in AXES]


def _by_axis(own: str, other: str, axis: int) -> list[str]:
    """Names of three coefficients, with another word for that of `axis`."""
    return [own if i == axis else f"{other} {name}" for i, name in enumerate(AXES)]


@dataclass(frozen=True, slots=True)
class AttitudeFits:
    """Fits of the channels x, y and z; None if not determined. `notes` name coefficients that cannot be separated."""

    accelerometers: tuple[AccelerometerFit | None, ...]
    gyros: tuple[GyroFit | None, ...]
    notes: tuple[str, ...]


def fit_attitudes(
    accelerometer_output: Array, gyro_output: Array, latitude_deg: float, pulse_per_deg: Array
) -> AttitudeFits:
    """Fit all channels from readings (24, 3) in pulse/s, NaN if missing; `pulse_per_deg` (3,) is KG from the rates.

    If the headings do not separate KG from the g-sensitivity, KG is taken as known.
    """
    notes: list[str] = []
    accelerometers, gyros = [], []
    for axis in range(len(AXES)):
        accelerometers.append(_attempt(notes, fit_accelerometer, accelerometer_output[:, axis], axis))
        at_rest, scale = gyro_output[:, axis], float(pulse_per_deg[axis])
        gyros.append(
            _attempt(notes, fit_gyro, at_rest, axis, latitude_deg)
            or _attempt(notes, fit_gyro_of_known_scale, at_rest, axis, latitude_deg, scale)
        )
    return AttitudeFits(tuple(accelerometers), tuple(gyros), tuple(notes))


def _attempt(notes: list[str], fit: Callable[Given, Fit], *args: Given.args, **kwargs: Given.kwargs) -> Fit | None:
    """Result of a fit; None, with a note, if it is not determined."""
    try:
        return fit(*args, **kwargs)
    except NotDetermined as problem:
        notes.append(str(problem))
        return None
