"""Temperature of a unit over a run on a rate table, without noise and drift of its thermometer.

A run on a table is short beside the time in which a unit warms up: its temperature follows a straight line. Means of a
few readings scatter about that line by the noise of the thermometer. If this scatter were taken for temperatures, a
budget would allow for changes of the scale factor that did not occur.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array, least_squares
from bench.metrology.pooled_scatter import Scatter, alike, pooled

LEAST_MEANS = 4  # two more than a line needs
SIGNIFICANCE = 3.0  # of a change, in standard uncertainties


@dataclass(frozen=True, slots=True)
class MeanTemperature:
    """Mean of the thermometer readings of one acquisition, NaN if there are none, and the scatter of one reading."""

    value_c: float
    readings: int
    scatter: Scatter

    @classmethod
    def of(cls, readings_c: Array) -> MeanTemperature:
        """Mean and scatter of readings (n,); the scatter of a single reading is unknown, and 0."""
        count = len(readings_c)
        sd_c = float(np.std(readings_c, ddof=1)) if count > 1 else 0.0
        return cls(float(np.mean(readings_c)) if count else np.nan, count, Scatter(sd_c, max(count - 1, 0)))


def temperatures_c(at_s: Sequence[float], means: Sequence[MeanTemperature], drift_c: Array) -> Array:
    """Temperatures (n,) of acquisitions at these times: of a straight line through the means, or the means themselves.

    The means are kept if they scatter about the line significantly more than their readings explain, if the readings do
    not scatter alike, or if there are too few to decide. A mean that is NaN stays NaN. Differences between times are
    reduced by the contribution of the thermometer to their squares: its noise, and its drift within the run, with
    errors `drift_c` (n,) at these times for one standard uncertainty.
    """
    value_c, time_s = np.array([each.value_c for each in means]), np.array(at_s)
    known = np.isfinite(value_c)
    of_one_reading = alike([each.scatter for each in means if each.readings])
    if of_one_reading is None or np.count_nonzero(known) < LEAST_MEANS or not np.ptp(time_s[known]):
        return value_c
    since = (time_s - time_s[known].mean()) / np.ptp(time_s[known])
    line = np.column_stack([np.ones_like(since), since])
    weight = np.sqrt([each.readings for each in means])[known]
    fit = least_squares(line[known] * weight[:, np.newaxis], value_c[known] * weight)
    middle_c, change_c = fit.coefficients
    by_both = pooled(Scatter(fit.residual_sd, fit.dof), of_one_reading)
    scatter_c = fit.residual_sd if by_both is None else by_both.sd
    change_u_c = np.hypot(scatter_c * np.sqrt(fit.unscaled_covariance[1, 1]), np.ptp(drift_c[known]))
    kept = beyond_error(change_c, float(change_u_c))
    off_line = 0.0 if by_both is not None else beyond_error(fit.residual_sd, of_one_reading.sd)
    left_c = value_c - line @ fit.coefficients
    return np.where(known, middle_c + kept * change_c * since + off_line * left_c, np.nan)


def warmed_c(at_s: Sequence[float], means: Sequence[MeanTemperature], drift_c: Array) -> float:
    """Change of a straight line through means; 0 if it is within its errors, or if there are too few means."""
    value_c, time_s = np.array([each.value_c for each in means]), np.array(at_s)
    known = np.isfinite(value_c)
    if np.count_nonzero(known) < LEAST_MEANS or not np.ptp(time_s[known]):
        return 0.0
    since = (time_s[known] - time_s[known].mean()) / np.ptp(time_s[known])
    fit = least_squares(np.column_stack([np.ones_like(since), since]), value_c[known])
    u_c = np.hypot(fit.residual_sd * np.sqrt(fit.unscaled_covariance[1, 1]), np.ptp(drift_c[known]))
    change_c = abs(float(fit.coefficients[1]))
    return change_c if change_c > SIGNIFICANCE * u_c else 0.0


def beyond_error(value: float, u: float) -> float:
    """Return the part of a value, 0 to 1, that its error does not explain, so that its square is not too large.

    The square of a value with the standard uncertainty u exceeds that of the true value by u² on average.
    """
    return float(np.sqrt(max(1 - (u / value) ** 2, 0.0))) if value else 0.0
