"""How well the line of a run is known by its own readings: what one count is worth, and what scatters beside it.

The errors of counts in neighbouring gates cancel each other, since what one has more the next has less: only the ends
of the record matter (methods.md 1.7). Residuals of the gates would make far too much of them. So the part of the count
is worked out from the latches that gates share, and the rest is looked for in means over longer stretches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.channel_temperature import Gates
from bench.analysis.codes import by_level
from bench.analysis.counts import RESOLUTION_COUNTS
from bench.analysis.fit import Array, NotDetermined, fit_polynomial

STRETCHES = 24  # of a run, long enough that what the input does within seconds averages out
SMOOTH_DEGREE = 3  # of the polynomial that the means scatter about
LEAST_GATES = 3 * STRETCHES
LATCH_COUNTS = RESOLUTION_COUNTS / np.sqrt(2)  # standard deviation of the charge that a latch has not counted yet
SAME_LATCH_S = 1e-3


@dataclass(frozen=True, slots=True)
class LineScatter:
    """Standard uncertainties of type A of a line's rate (pulse/s) and slope (pulse/s/°C).

    `counting_` is of the count alone, `scatter_` of the rest with `dof` degrees of freedom. `excess_pps` is the
    standard deviation of the rest in a mean over one stretch, which is `stretch_s` long. `residuals_pps` (m,) are
    those of the means of the stretches from the line, none where the run is too short for stretches. `drift_h_per_c`
    and `accelerometer_per_c` are what a line over the converter's temperature gives for time (h) and for the
    accelerometer's temperature (°C): an input that drifts, or follows the chamber, changes the slope by so much.
    `step_u_pps` is what the steps of codes hide from a mean, 0 for volts; None where pulses were counted.
    """

    counting_rate: float
    counting_slope: float
    scatter_rate: float
    scatter_slope: float
    dof: int
    excess_pps: float
    stretch_s: float
    residuals_pps: Array
    drift_h_per_c: float
    accelerometer_per_c: float
    step_u_pps: float | None = None

    def mean_u_pps(self, span_s: float) -> float:
        """Standard uncertainty of a mean rate over `span_s`, of the count or the steps of codes, and the rest."""
        alone_pps = RESOLUTION_COUNTS / span_s if self.step_u_pps is None else self.step_u_pps
        return float(np.hypot(alone_pps, self.excess_pps * np.sqrt(self.stretch_s / span_s)))


def line_scatter(gates: Gates, reference_c: float) -> LineScatter:
    """What the gates of a run tell of their line; raises NotDetermined with fewer than three gates to a stretch."""
    count = len(gates.seconds)
    if count < LEAST_GATES or not np.ptp(gates.converter_c):
        raise NotDetermined(("scatter",), rank=count, of=LEAST_GATES, condition=np.inf)
    centre_c = float(np.mean(gates.converter_c))
    slope_gain = (gates.converter_c - centre_c) / np.sum((gates.converter_c - centre_c) ** 2)
    rate_gain = 1 / count + (reference_c - centre_c) * slope_gain
    smooth = fit_polynomial(gates.converter_c, gates.rate_pps, SMOOTH_DEGREE).residuals
    line = fit_polynomial(gates.converter_c, gates.rate_pps, 1).residuals
    means, stretches_s = _stretches(smooth, gates.seconds)
    dof = STRETCHES - SMOOTH_DEGREE - 1
    counted = float(np.mean((RESOLUTION_COUNTS / stretches_s) ** 2)) if gates.step_u is None else 0.0
    found = float(np.sum(means**2)) / dof
    excess_pps = np.sqrt(max(found - counted, 0.0))
    slope_means, rate_means = (_sums(gain) for gain in (slope_gain, rate_gain))
    accelerometer_c = np.where(np.isfinite(gates.accelerometer_c), gates.accelerometer_c, 0.0)
    return LineScatter(
        counting_rate=_counting(rate_gain, gates),
        counting_slope=_counting(slope_gain, gates),
        scatter_rate=float(excess_pps * np.linalg.norm(rate_means)),
        scatter_slope=float(excess_pps * np.linalg.norm(slope_means)),
        dof=dof,
        excess_pps=float(excess_pps),
        stretch_s=float(np.mean(stretches_s)),
        residuals_pps=_stretches(line, gates.seconds)[0],
        drift_h_per_c=float(slope_gain @ gates.time_s) / 3600.0,
        accelerometer_per_c=float(slope_gain @ accelerometer_c),
        step_u_pps=None if gates.step_u is None else float(np.mean(gates.step_u)),
    )


def _counting(gain: Array, gates: Gates) -> float:
    """What the latches leave uncounted, in a sum of gates with these gains; gates side by side share a latch.

    Or it is what the steps of codes hide: gates whose means are on one step err alike.
    """
    if gates.step_u is not None:
        largest = float(np.max(gates.step_u, initial=0.0)) * np.sqrt(12)
        on_step = np.round(gates.rate_pps / largest) if largest else gates.time_s
        return float(np.linalg.norm(by_level(gain, gates.step_u, on_step)))
    per_count = gain / gates.seconds
    end_s, begin_s = gates.time_s + gates.seconds / 2, gates.time_s - gates.seconds / 2
    shared = np.abs(begin_s[1:] - end_s[:-1]) < SAME_LATCH_S
    own = np.sum(per_count[:-1][~shared] ** 2) + np.sum(per_count[1:][~shared] ** 2)
    common = np.sum((per_count[1:] - per_count[:-1])[shared] ** 2)
    return float(LATCH_COUNTS * np.sqrt(own + common + per_count[0] ** 2 + per_count[-1] ** 2))


def _stretches(residual_pps: Array, seconds: Array) -> tuple[Array, Array]:
    """The mean of each stretch, and how long it is."""
    stretches_s = _sums(seconds)
    return _sums(residual_pps * seconds) / stretches_s, stretches_s


def _sums(values: Array) -> Array:
    return np.array([float(np.sum(part)) for part in np.array_split(values, STRETCHES)])
