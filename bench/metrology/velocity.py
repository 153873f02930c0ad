"""Velocity from counts: the integral of a channel's specific force, compensated for temperature (equations 2.5).

At a specific force a the channel gives D = D_ref (1 + α ΔT) + β ΔT with D_ref = K1 (a + K0) and ΔT = T - Tref. The two
drifts are those of item 7, and each alone is one of the shared models: α = κ, β = 0 on the basis "normalised"; α = 0,
β = k on the basis "raw", or with the k of a level of its own. So a = [(D - β ΔT) / (1 + α ΔT)] / K1 - K0, and velocity
is g times its integral over time. The integral of D is the count itself: no rate is sampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.metrology.least_squares import Array
from bench.metrology.pulse_counts import RESOLUTION_COUNTS


@dataclass(frozen=True, slots=True)
class ChannelModel:
    """An accelerometer channel over temperature: its calibration at `reference_c` and its drift from there.

    `covariance` (4, 4) is that of `scale_pps_per_g` (K1), `bias_g` (K0), `scale_drift_per_c` (α) and
    `offset_drift_pps_per_c` (β), in this order.
    """

    reference_c: float
    scale_pps_per_g: float
    bias_g: float
    scale_drift_per_c: float
    offset_drift_pps_per_c: float
    covariance: Array

    def without_drift(self) -> ChannelModel:
        """The channel without compensation: at all temperatures as calibrated at one."""
        kept = np.diag([1.0, 1.0, 0.0, 0.0])
        covariance = kept @ self.covariance @ kept
        return replace(self, scale_drift_per_c=0.0, offset_drift_pps_per_c=0.0, covariance=covariance)


@dataclass(frozen=True, slots=True)
class VelocityRecord:
    """Counts and temperatures of one run in the order of time, on one clock, without gaps or missing numbers.

    `net_pulses` (n,) are cumulative, positive less negative, at `time_s` (n,) of the counter; wraps are undone.
    `temperature_c` (m,) of the converter at `temperature_time_s` (m,) is linear between readings and constant beyond.
    """

    time_s: Array
    net_pulses: Array
    temperature_time_s: Array
    temperature_c: Array


@dataclass(frozen=True, slots=True)
class Velocity:
    """Velocity (n,) in m/s since the first of the times (n,), and the mean specific force in g between them (n - 1,).

    `u_model_mps` (n,) is from the model: one error throughout, growing with time. `u_count_mps` (n,) is from the
    fractions of a pulse at the first time and at this one: it does not grow. The sensor's noise is in neither.
    """

    time_s: Array
    velocity_mps: Array
    force_g: Array
    u_model_mps: Array
    u_count_mps: Array

    @property
    def u_mps(self) -> Array:
        """Combined standard uncertainty (n,)."""
        return np.hypot(self.u_model_mps, self.u_count_mps)


def integrate(record: VelocityRecord, model: ChannelModel, gravity_mps2: float) -> Velocity:
    """Integrate one run to the compensated velocity.

    The pulses between two counts are assumed evenly distributed, which matters only for the temperature change there.
    """
    elapsed_s = record.time_s - record.time_s[0]
    k1, beta = model.scale_pps_per_g, model.offset_drift_pps_per_c
    drift = _drift_integrals(record, model)
    referred_pulses = _counted(record, drift.gain) - beta * drift.away
    velocity_gs = referred_pulses / k1 - model.bias_g * elapsed_s
    derivatives_gs = np.stack([
        -referred_pulses / k1**2,
        -elapsed_s,
        (beta * drift.away_squared - _counted(record, drift.away_gain)) / k1,
        -drift.away / k1,
    ])  # fmt: skip
    variance = np.einsum("in,ij,jn->n", derivatives_gs, model.covariance, derivatives_gs)
    counted = np.where(elapsed_s > 0, RESOLUTION_COUNTS, 0.0)
    return Velocity(
        time_s=record.time_s,
        velocity_mps=gravity_mps2 * velocity_gs,
        force_g=np.diff(velocity_gs) / np.diff(elapsed_s),
        u_model_mps=gravity_mps2 * np.sqrt(np.maximum(variance, 0.0)),
        u_count_mps=gravity_mps2 * counted / abs(k1),
    )


@dataclass(frozen=True, slots=True)
class VelocityError:
    """Largest error of velocity in a run, with its sign, its standard uncertainty, and its time."""

    error_mps: float
    u_mps: float
    time_s: float


@dataclass(frozen=True, slots=True)
class VelocityComparison:
    """Effect of compensation on the velocity of one run: largest error without and with it."""

    raw: VelocityError
    compensated: VelocityError


def compare_velocity(
    record: VelocityRecord, model: ChannelModel, *, force_g: float, gravity_mps2: float
) -> VelocityComparison:
    """Integrate a run under a constant, known specific force with and without the model's drift."""

    def error(used: ChannelModel) -> VelocityError:
        found = integrate(record, used, gravity_mps2)
        away_mps = found.velocity_mps - gravity_mps2 * force_g * (found.time_s - found.time_s[0])
        worst = int(np.argmax(np.abs(away_mps)))
        return VelocityError(float(away_mps[worst]), float(found.u_mps[worst]), float(found.time_s[worst]))

    return VelocityComparison(raw=error(model.without_drift()), compensated=error(model))


@dataclass(frozen=True, slots=True)
class _DriftIntegrals:
    """Integrals from the first to each time of the counter (n,), in s and °C, with w = 1 / (1 + α ΔT)."""

    gain: Array  # of w
    away: Array  # of ΔT w
    away_gain: Array  # of ΔT w²
    away_squared: Array  # of ΔT² w²


def _drift_integrals(record: VelocityRecord, model: ChannelModel) -> _DriftIntegrals:
    """Integrals by Simpson's rule on each linear piece of the temperature; the error is of the order (α ΔT)⁴."""
    inner = (record.temperature_time_s > record.time_s[0]) & (record.temperature_time_s < record.time_s[-1])
    corners_s = np.union1d(record.time_s, record.temperature_time_s[inner])
    away_c = np.interp(corners_s, record.temperature_time_s, record.temperature_c) - model.reference_c
    nodes_c = np.stack([away_c[:-1], (away_c[:-1] + away_c[1:]) / 2, away_c[1:]])
    weights = np.array([1.0, 4.0, 1.0]) / 6
    at = np.searchsorted(corners_s, record.time_s)

    def integral(values: Array) -> Array:
        return np.asarray(np.concatenate(([0.0], np.cumsum(weights @ values * np.diff(corners_s))))[at])

    gain = 1 / (1 + model.scale_drift_per_c * nodes_c)
    return _DriftIntegrals(
        gain=integral(gain),
        away=integral(nodes_c * gain),
        away_gain=integral(nodes_c * gain**2),
        away_squared=integral((nodes_c * gain) ** 2),
    )


def _counted(record: VelocityRecord, integral: Array) -> Array:
    """Pulses up to each time, those of an interval times the mean there of the integrand of `integral`."""
    mean = np.diff(integral) / np.diff(record.time_s)
    return np.concatenate(([0.0], np.cumsum(np.diff(record.net_pulses) * mean)))
