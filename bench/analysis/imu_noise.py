"""How much one reading of an inertial unit scatters, from what the readings of a run leave of their fits.

Readings at rest are all counted for equally long. Those at the rates are not: at a low rate a turn takes longer. The
noise of a gyro's mean rate falls with the root of the time it is counted for (its angle random walk), so that short
readings, which are those of the highest rates and decide the slope, scatter most. What is pooled is therefore the
density: the scatter of a reading of 1 s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np

from bench.analysis.attitude_fit import GyroFit
from bench.analysis.attitudes import AXES
from bench.analysis.counts import RESOLUTION_COUNTS
from bench.analysis.fit import Array, LinearFit, NotDetermined, least_squares
from bench.analysis.imu_calibration import ImuCalibration
from bench.analysis.imu_readings import ImuReadings
from bench.analysis.imu_windows import Visit
from bench.analysis.rundata import UnitUnderTest


@dataclass(frozen=True, slots=True)
class Noise:
    """The scatter about their fits of the readings of one axis, pooled over the run, with its degrees of freedom.

    At rest it is the standard deviation of a reading in pulse/s. While turned, about its own axis and about the others,
    it is the density in pulse/s·√s: over the root of its length in s, the standard deviation of a reading.
    """

    accelerometer: tuple[float, int]
    gyro_at_rest: tuple[float, int]
    gyro_turning: tuple[float, int]
    gyro_across: tuple[float, int]


def noise_of(
    axis: int, unit: UnitUnderTest, visits: Sequence[Visit], arranged: ImuReadings, found: ImuCalibration,
    over_attitudes: Sequence[GyroFit | None],
) -> Noise:  # fmt: skip
    """The noise of one axis; `over_attitudes` are the fits of its gyro over the attitudes of each visit.

    A reading is not believed to scatter less than what the count resolves: equal counts in equal windows show nothing
    of it. About its own axis a gyro's scatter holds that of the table's rate, about the others hardly anything of it:
    the six rates of a visit tell a standard deviation badly, which is therefore no less than what the others tell.
    """
    scatter = found.scatter[axis]
    every = found.over_temperature(axis)
    resolution_pps = _resolution_pps(visits)
    turned = [(each.rate_dps, each.dwell_s, each.gyro_pps) for each in (visit[axis] for visit in arranged.rates)]
    others = [other for other in range(len(AXES)) if other != axis]
    across = [about_another(axis, other, unit, visit) for visit, other in product(visits, others)]
    by_others = _density(across)
    at_rest_pps, dof = _at_rest(over_attitudes) or (scatter.gyro_at_rest_pps, _dof([one.gyro_at_rest for one in every]))
    return Noise(
        (max(scatter.accelerometer_pps, resolution_pps), _dof([one.accelerometer for one in every])),
        (max(at_rest_pps, resolution_pps), dof),
        max(_density(turned), by_others),
        by_others,
    )


def _at_rest(fits: Sequence[GyroFit | None]) -> tuple[float, int] | None:
    """Of a reading at rest, over all attitudes: those in which an axis is vertical leave few degrees of freedom."""
    known = [fit for fit in fits if fit is not None]
    dof = sum(fit.dof for fit in known)
    return (float(np.sqrt(sum(fit.squares for fit in known) / dof)), dof) if dof else None


def about_another(axis: int, other: int, unit: UnitUnderTest, visit: Visit) -> tuple[Array, Array, Array]:
    """What a gyro read while another axis was turned: rates (r,) in °/s, for how long, and pulse/s; only good ones."""
    turned = visit.turned(other)
    windows = [each.acquisition.windows[unit.channels[f"gyro_{AXES[axis]}"]] for each in turned]
    rows = np.array(
        [(each.rate_dps, window.span_s, window.net_pps) for each, window in zip(turned, windows, strict=True)]
    ).reshape(-1, 3)
    rate_dps, span_s, pps = rows[np.isfinite(rows).all(axis=-1)].T
    return rate_dps, span_s, pps


def _density(readings: Iterable[tuple[Array, Array, Array]]) -> tuple[float, int]:
    """Pooled over several lines through readings: rates, for how long, and pulse/s.

    What is even in the rate is taken away: a gyro's asymmetry scatters nothing, and turns no line.
    """
    squares, dof, resolution = 0.0, 0, 0.0
    for rate_dps, span_s, pps in readings:
        weights = np.sqrt(span_s)
        columns = np.stack([np.ones_like(rate_dps), rate_dps, np.abs(rate_dps)], axis=-1)
        with suppress(NotDetermined):
            fit = least_squares(columns * weights[:, np.newaxis], pps * weights)
            squares, dof = squares + float(np.sum(fit.residuals**2)), dof + fit.dof
            resolution = RESOLUTION_COUNTS / float(np.sqrt(np.median(span_s)))
    return (max(float(np.sqrt(squares / dof)), resolution), dof) if dof else (0.0, 0)


def _resolution_pps(visits: Sequence[Visit]) -> float:
    """What the count resolves in the usual window at rest."""
    spans_s = [
        window.span_s
        for visit in visits
        for each in visit.at_rest
        for window in each.acquisition.windows.values()
        if window.span_s
    ]
    return RESOLUTION_COUNTS / float(np.median(spans_s)) if spans_s else 0.0


def _dof(fits: Sequence[LinearFit]) -> int:
    return sum(fit.dof for fit in fits)
