"""How well the line of a run is known by its own readings: what one count is worth, and what scatters beside it.

The errors of counts in neighbouring gates cancel each other, since what one has more the next has less: only the ends
of the record matter (equations 1.7). Residuals of the gates would make far too much of them. So the part of the count
is worked out from the latches that gates share. The rest is looked for in slow waves of the gates, nearly as slow as
the line: there the count leaves next to nothing, and what comes and goes within a minute or two does not tilt a line
either. A chamber's limit cycle, which the thermometer tells a little later than the converter has it, does reach into
the slow waves; but it goes with the rate of the temperature, and what does is lag and no scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from bench.metrology.gates import Gates
from bench.metrology.least_squares import Array, NotDetermined, fit_polynomial
from bench.metrology.pulse_counts import RESOLUTION_COUNTS
from bench.metrology.sampled_codes import by_level
from bench.metrology.temperature_checks import rates_c_per_s

STRETCHES = 24  # of a run, long enough that what the input does within seconds averages out
SMOOTH_DEGREE = 3  # of the polynomial that gates scatter about
WAVES_DEGREE = 17  # of the steepest polynomial in time that is still a slow wave
LEAST_GATES = 3 * STRETCHES
LAG_GATES = 5  # whose slope is the rate of the temperature: noise of the thermometer is most of what fewer differ by
LATCH_COUNTS = RESOLUTION_COUNTS / np.sqrt(2)  # standard deviation of the charge that a latch has not counted yet
SAME_LATCH_S = 1e-3


@dataclass(frozen=True, slots=True)
class LineScatter:
    """Standard uncertainties of type A of a line's rate (pulse/s) and slope (pulse/s/°C).

    `counting_` is of the count alone, `scatter_` of the rest with `dof` degrees of freedom. `excess` is the
    standard deviation of a gate that is `gate_s` long, what lags included. `residuals` (m,) are what the means of
    stretches are away from the line, and `stretch_u` is what they scatter by; none where the run is too short.
    `drift_h_per_c` and `accelerometer_per_c` are what a line over the converter's temperature gives for time (h) and
    for the accelerometer's temperature (°C): an input that drifts or follows the chamber changes the slope by so much.
    `step_u` is what the steps of codes hide from a mean, 0 for volts; None where pulses were counted.
    """

    counting_rate: float
    counting_slope: float
    scatter_rate: float
    scatter_slope: float
    dof: int
    excess: float
    gate_s: float
    residuals: Array
    stretch_u: float
    drift_h_per_c: float
    accelerometer_per_c: float
    step_u: float | None = None

    def mean_u(self, span_s: float) -> float:
        """Standard uncertainty of a mean rate over `span_s`, of the count or the steps of codes, and the rest."""
        alone = RESOLUTION_COUNTS / span_s if self.step_u is None else self.step_u
        return float(np.hypot(alone, self.excess * np.sqrt(self.gate_s / span_s)))


def line_scatter(gates: Gates, reference_c: float) -> LineScatter:
    """What the gates of a run tell of their line; raises NotDetermined with fewer than three gates to a stretch."""
    count = len(gates.seconds)
    if count < LEAST_GATES or not np.ptp(gates.converter_c):
        raise NotDetermined(("scatter",), rank=count, of=LEAST_GATES, condition=np.inf)
    slope_gain, rate_gain = line_gains(gates.converter_c, reference_c)
    smooth = fit_polynomial(gates.converter_c, gates.rate, SMOOTH_DEGREE).residuals
    line = fit_polynomial(gates.converter_c, gates.rate, 1).residuals
    own = own_scatter(smooth, gates)
    counting_slope, counting_rate = np.linalg.norm(unresolved_u(np.stack([slope_gain, rate_gain]), gates), axis=1)
    accelerometer_c = np.where(np.isfinite(gates.accelerometer_c), gates.accelerometer_c, 0.0)
    return LineScatter(
        counting_rate=float(counting_rate),
        counting_slope=float(counting_slope),
        scatter_rate=float(own * np.linalg.norm(rate_gain)),
        scatter_slope=float(own * np.linalg.norm(slope_gain)),
        dof=WAVES_DEGREE - SMOOTH_DEGREE,
        excess=excess(smooth, gates),
        gate_s=float(np.mean(gates.seconds)),
        residuals=_stretches(line, gates.seconds)[0],
        stretch_u=_stretch_u(smooth, gates),
        drift_h_per_c=float(slope_gain @ gates.time_s) / 3600.0,
        accelerometer_per_c=float(slope_gain @ accelerometer_c),
        step_u=None if gates.step_u is None else float(np.mean(gates.step_u)),
    )


def line_gains(converter_c: Array, reference_c: float) -> tuple[Array, Array]:
    """What each gate (n,) adds to the slope of a straight line through all, and to its value at the reference."""
    centre_c = float(np.mean(converter_c))
    slope_gain = (converter_c - centre_c) / np.sum((converter_c - centre_c) ** 2)
    return slope_gain, 1 / len(converter_c) + (reference_c - centre_c) * slope_gain


def own_scatter(departures: Array, gates: Gates) -> float:
    """As `excess` of departures (n,) from a smooth curve, but without what goes with the rate of the temperature.

    The gates at the ends have no such rate, and are left out.
    """
    rate_c_per_s = rates_c_per_s(gates.time_s, gates.converter_c, LAG_GATES)
    inner = np.arange(len(rate_c_per_s)) + LAG_GATES // 2
    lag = fit_polynomial(gates.converter_c[inner], rate_c_per_s, SMOOTH_DEGREE).residuals
    own, size = departures[inner], float(lag @ lag)
    if size:
        own = own - lag * (lag @ own) / size
    return excess(own, gates.rows(inner))


def unresolved_u(gains: Array, gates: Gates) -> Array:
    """What a count leaves uncounted in sums of gates with gains (k, n), or the steps of codes hide: (k, m) by cause.

    Gates whose means are on one step err alike.
    """
    if gates.step_u is None:
        return _of_latches(gains, gates)
    largest = float(np.max(gates.step_u, initial=0.0)) * np.sqrt(12)
    on_step = np.round(gates.rate / largest) if largest else gates.time_s
    return np.stack([by_level(gain, gates.step_u, on_step) for gain in gains])


def _of_latches(gains: Array, gates: Gates) -> Array:
    """What the latches leave uncounted in sums of gates with gains (k, n): the standard deviation by latch (k, m).

    Gates side by side share a latch: what the one has more, the other has less.
    """
    end_s, begin_s = gates.time_s + gates.seconds / 2, gates.time_s - gates.seconds / 2
    apart = np.abs(begin_s[1:] - end_s[:-1]) >= SAME_LATCH_S
    begins = np.arange(len(gates.seconds)) + np.concatenate(([0], np.cumsum(apart)))
    per_count = gains / gates.seconds
    found = np.zeros((len(gains), int(begins[-1]) + 2))
    found[:, begins] -= per_count
    found[:, begins + 1] += per_count
    return np.asarray(LATCH_COUNTS * found)


def excess(residual: Array, gates: Gates) -> float:
    """The standard deviation of a gate that is not of the count, as far as slow waves of the gates have it.

    So large that the squares of the waves are together what they should be (Paule and Mandel, J. Res. NBS 87, 377):
    those in which the count leaves the least tell the most. Nothing where the count alone would scatter as much.
    """
    from scipy.optimize import brentq  # and much with it, which most runs do not need

    through = chebyshev.chebvander(np.linspace(-1, 1, len(residual)), WAVES_DEGREE)
    waves = np.linalg.qr(through)[0][:, SMOOTH_DEGREE + 1 :].T
    unresolved = unresolved_u(waves, gates)
    counted, apart = np.linalg.eigh(unresolved @ unresolved.T)  # waves share the latches at the ends
    squares = (apart.T @ waves @ residual) ** 2
    if not unresolved.any():
        return float(np.sqrt(np.mean(squares)))
    counted = np.maximum(counted, np.finfo(np.float64).eps * counted[-1])  # few steps of codes hide nothing of some

    usual = float(np.mean(squares))

    def surplus(share: float) -> float:
        return float(np.sum(squares / (counted + share * usual))) - len(squares)

    return float(np.sqrt(usual * brentq(surplus, 0.0, 2.0))) if surplus(0.0) > 0 else 0.0


def _stretch_u(residual: Array, gates: Gates) -> float:
    """What the means of stretches scatter by, of which the count is the least, or the steps of codes."""
    means, stretches_s = _stretches(residual, gates.seconds)
    found = float(np.sum(means**2)) / (STRETCHES - SMOOTH_DEGREE - 1)
    alone = RESOLUTION_COUNTS / stretches_s if gates.step_u is None else gates.step_u
    return float(np.sqrt(max(found, float(np.mean(alone**2)))))


def _stretches(residual: Array, seconds: Array) -> tuple[Array, Array]:
    """The mean of each stretch, and how long it is."""
    stretches_s = _sums(seconds)
    return _sums(residual * seconds) / stretches_s, stretches_s


def _sums(values: Array) -> Array:
    return np.array([float(np.sum(part)) for part in np.array_split(values, STRETCHES)])
