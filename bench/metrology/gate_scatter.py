"""Uncertainty of the line of a run from its own readings: resolution of the count, and additional scatter.

The errors of counts in neighbouring gates cancel, since one gate has a count more and the next has it less: only the
ends of the record matter (equations 1.7). Residuals of the gates would overestimate them by far. Therefore the part of
the count is computed from the latches that gates share. The rest is estimated from slow waves of the gates, nearly as
slow as the line: there the count contributes next to nothing, and disturbances of a minute or two do not tilt a line
either. A chamber's limit cycle, which the thermometer shows slightly later than the converter, does reach into the slow
waves; but it is proportional to the rate of the temperature, and such a part is lag, not scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from bench.metrology.gates import Gates
from bench.metrology.least_squares import Array, NotDetermined, fit_polynomial
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.sampled_codes import quantisation_by_level
from bench.metrology.temperature_checks import rates_c_per_s

STRETCHES = 24  # of a run; long enough to average out input variations within seconds
SMOOTH_DEGREE = 3  # degree of the polynomial for the scatter of gates
WAVES_DEGREE = 17  # highest degree of a polynomial in time that counts as a slow wave
LEAST_GATES = 3 * STRETCHES
LAG_GATES = 5  # gates for the rate of the temperature: with fewer, noise of the thermometer dominates
LATCH_COUNTS = RESOLUTION_COUNTS / np.sqrt(2)  # standard deviation of the charge not yet counted at a latch
SAME_LATCH_S = 1e-3


@dataclass(frozen=True, slots=True)
class LineScatter:
    """Standard uncertainties of type A of a line's rate (pulse/s) and slope (pulse/s/°C).

    `counting_` is of the count alone, `scatter_` of the rest with `dof` degrees of freedom. `excess_pps` is the
    standard deviation of a gate that is `gate_s` long, what lags included. `residuals_pps` (m,) are the deviations of
    the means of stretches from the line, `stretch_u_pps` is their standard deviation; none where the run is too short.
    `drift_h_per_c` and `accelerometer_per_c` are the slopes over the converter's temperature of time (h) and of the
    accelerometer's temperature (°C): the sensitivity to an input that drifts or follows the chamber.
    `quantisation_u_pps` is the quantisation uncertainty of a mean of codes, 0 for volts; None for counted pulses.
    """

    counting_rate: float
    counting_slope: float
    scatter_rate: float
    scatter_slope: float
    dof: int
    excess_pps: float
    gate_s: float
    residuals_pps: Array
    stretch_u_pps: float
    drift_h_per_c: float
    accelerometer_per_c: float
    quantisation_u_pps: float | None = None

    def mean_u_pps(self, span_s: float) -> float:
        """Standard uncertainty of a mean rate over `span_s`: from counting or quantisation, and from the rest."""
        alone_pps = RESOLUTION_COUNTS / span_s if self.quantisation_u_pps is None else self.quantisation_u_pps
        return float(np.hypot(alone_pps, self.excess_pps * np.sqrt(self.gate_s / span_s)))


def line_scatter(gates: Gates, reference_c: float) -> LineScatter:
    """Uncertainty of the line of a run from its gates; NotDetermined with fewer than three gates to a stretch."""
    count = len(gates.seconds)
    if count < LEAST_GATES or not np.ptp(gates.converter_c):
        raise NotDetermined(("scatter",), rank=count, of=LEAST_GATES, condition=np.inf)
    slope_gain, rate_gain = line_gains(gates.converter_c, reference_c)
    smooth = fit_polynomial(gates.converter_c, gates.rate_pps, SMOOTH_DEGREE).residuals
    line = fit_polynomial(gates.converter_c, gates.rate_pps, 1).residuals
    own_pps = own_scatter_pps(smooth, gates)
    counting_slope, counting_rate = np.linalg.norm(unresolved_pps(np.stack([slope_gain, rate_gain]), gates), axis=1)
    accelerometer_c = np.where(np.isfinite(gates.accelerometer_c), gates.accelerometer_c, 0.0)
    return LineScatter(
        counting_rate=float(counting_rate),
        counting_slope=float(counting_slope),
        scatter_rate=float(own_pps * np.linalg.norm(rate_gain)),
        scatter_slope=float(own_pps * np.linalg.norm(slope_gain)),
        dof=WAVES_DEGREE - SMOOTH_DEGREE,
        excess_pps=excess_pps(smooth, gates),
        gate_s=float(np.mean(gates.seconds)),
        residuals_pps=_stretches(line, gates.seconds)[0],
        stretch_u_pps=_stretch_u_pps(smooth, gates),
        drift_h_per_c=float(slope_gain @ gates.time_s) / 3600.0,
        accelerometer_per_c=float(slope_gain @ accelerometer_c),
        quantisation_u_pps=None if gates.quantisation_u is None else float(np.mean(gates.quantisation_u)),
    )


def line_gains(converter_c: Array, reference_c: float) -> tuple[Array, Array]:
    """Sensitivity of slope and value at the reference, of a straight line through all gates, to each gate (n,)."""
    centre_c = float(np.mean(converter_c))
    slope_gain = (converter_c - centre_c) / np.sum((converter_c - centre_c) ** 2)
    return slope_gain, 1 / len(converter_c) + (reference_c - centre_c) * slope_gain


def own_scatter_pps(smooth_pps: Array, gates: Gates) -> float:
    """Standard deviation as `excess_pps` of deviations (n,) from a smooth curve, without lag.

    Lag is the part proportional to the rate of the temperature. The gates at the ends have no such rate, and are left
    out.
    """
    rate_c_per_s = rates_c_per_s(gates.time_s, gates.converter_c, LAG_GATES)
    inner = np.arange(len(rate_c_per_s)) + LAG_GATES // 2
    lag = fit_polynomial(gates.converter_c[inner], rate_c_per_s, SMOOTH_DEGREE).residuals
    own_pps, size = smooth_pps[inner], float(lag @ lag)
    if size:
        own_pps = own_pps - lag * (lag @ own_pps) / size
    return excess_pps(own_pps, gates.rows(inner))


def unresolved_pps(gains: Array, gates: Gates) -> Array:
    """Uncertainty from counting or quantisation of sums of gates with gains (k, n): (k, m) by cause.

    Gates whose means are in one quantisation step have the same error.
    """
    if gates.quantisation_u is None:
        return _of_latches(gains, gates)
    largest = float(np.max(gates.quantisation_u, initial=0.0)) * np.sqrt(12)
    on_step = np.round(gates.rate_pps / largest) if largest else gates.time_s
    return np.stack([quantisation_by_level(gain, gates.quantisation_u, on_step) for gain in gains])


def _of_latches(gains: Array, gates: Gates) -> Array:
    """Counting uncertainty of sums of gates with gains (k, n): the standard deviation by latch (k, m).

    Adjacent gates share a latch: a count that one has more, the other has less.
    """
    end_s, begin_s = gates.time_s + gates.seconds / 2, gates.time_s - gates.seconds / 2
    apart = np.abs(begin_s[1:] - end_s[:-1]) >= SAME_LATCH_S
    begins = np.arange(len(gates.seconds)) + np.concatenate(([0], np.cumsum(apart)))
    per_count = gains / gates.seconds
    found = np.zeros((len(gains), int(begins[-1]) + 2))
    found[:, begins] -= per_count
    found[:, begins + 1] += per_count
    return np.asarray(LATCH_COUNTS * found)


def excess_pps(residual_pps: Array, gates: Gates) -> float:
    """Standard deviation of a gate beyond the count, as far as slow waves of the gates show it.

    Chosen so that the squares of the waves sum to their expectation (Paule and Mandel, J. Res. NBS 87, 377): the waves
    with the least counting error have the most weight. 0 if the count alone would scatter as much.
    """
    from scipy.optimize import brentq  # imports many modules, which most runs do not need

    through = chebyshev.chebvander(np.linspace(-1, 1, len(residual_pps)), WAVES_DEGREE)
    waves = np.linalg.qr(through)[0][:, SMOOTH_DEGREE + 1 :].T
    unresolved = unresolved_pps(waves, gates)
    counted, apart = np.linalg.eigh(unresolved @ unresolved.T)  # waves share the latches at the ends
    squares = (apart.T @ waves @ residual_pps) ** 2
    if not unresolved.any():
        return float(np.sqrt(np.mean(squares)))
    # few steps of codes, so that some waves have no quantisation error
    counted = np.maximum(counted, np.finfo(np.float64).eps * counted[-1])

    usual = float(np.mean(squares))

    def surplus(share: float) -> float:
        return float(np.sum(squares / (counted + share * usual))) - len(squares)

    return float(np.sqrt(usual * brentq(surplus, 0.0, 2.0))) if surplus(0.0) > 0 else 0.0


def _stretch_u_pps(residual_pps: Array, gates: Gates) -> float:
    """Standard deviation of the means of stretches; at least that of the count, or of the quantisation."""
    means, stretches_s = _stretches(residual_pps, gates.seconds)
    found = float(np.sum(means**2)) / (STRETCHES - SMOOTH_DEGREE - 1)
    alone_pps = RESOLUTION_COUNTS / stretches_s if gates.quantisation_u is None else gates.quantisation_u
    return float(np.sqrt(max(found, float(np.mean(alone_pps**2)))))


def _stretches(residual_pps: Array, seconds: Array) -> tuple[Array, Array]:
    """Mean and duration of each stretch."""
    stretches_s = _sums(seconds)
    return _sums(residual_pps * seconds) / stretches_s, stretches_s


def _sums(values: Array) -> Array:
    return np.array([float(np.sum(part)) for part in np.array_split(values, STRETCHES)])
