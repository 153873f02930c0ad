"""Scatter of one reading of an inertial unit, from the residuals of the fits of a run.

Readings at rest all have the same duration. Those at the rates have not: at a low rate a turn takes longer. The noise
of a gyro's mean rate falls with the root of its duration (angle random walk), so that short readings, which are those
of the highest rates and determine the slope, scatter most. Therefore the density is pooled: the scatter of a reading of
1 s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from bench.methods.imu.reduction.attitude_fit import GyroFit
from bench.methods.imu.reduction.calibrate import ImuCalibration
from bench.methods.imu.reduction.records import ImuReadings
from bench.methods.imu.reduction.windows import Visit
from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares
from bench.metrology.run_data import AXES, UnitUnderTest


@dataclass(frozen=True, slots=True)
class Noise:
    """Scatter of the readings of one axis about their fits, pooled over the run, with its degrees of freedom.

    At rest it is the standard deviation of a reading in the unit of the output. During rotation, about its own axis and
    about the others, it is the density in that unit times √s: divided by the root of the duration in s it is the
    standard deviation of a reading.
    """

    accelerometer: tuple[float, int]
    gyro_at_rest: tuple[float, int]
    gyro_turning: tuple[float, int]
    gyro_across: tuple[float, int]


def noise_of(
    axis: int, unit: UnitUnderTest, visits: Sequence[Visit], arranged: ImuReadings, found: ImuCalibration,
    over_attitudes: Sequence[GyroFit | None],
) -> Noise:  # fmt: skip
    """Noise of one axis; `over_attitudes` are the fits of its gyro over the attitudes of each visit.

    The scatter of a reading is at least its single-reading uncertainty: equal counts in equal windows do not show the
    resolution of the count, and samples have their own scatter. About its own axis a gyro's scatter contains that of
    the table's rate, about the others hardly any of it: the six rates of a visit determine a standard deviation poorly,
    which is therefore at least that of the others.
    """
    scatter = found.scatter[axis]
    every = found.over_temperature(axis)
    accelerometer_output, gyro_output = (
        _alone(unit.channels[f"{each}_{AXES[axis]}"], visits) for each in ("acc", "gyro")
    )
    floor = _alone_density(unit.channels[f"gyro_{AXES[axis]}"], visits)
    turned = [(each.rate_dps, each.dwell_s, each.gyro_output) for each in (visit[axis] for visit in arranged.rates)]
    others = [other for other in range(len(AXES)) if other != axis]
    across = [about_another(axis, other, unit, visit) for visit, other in product(visits, others)]
    by_others = _density([(each.rate_dps, each.span_s, each.output) for each in across], floor)
    at_rest_output, dof = _at_rest(over_attitudes) or (
        scatter.gyro_at_rest_output,
        _dof([one.gyro_at_rest for one in every]),
    )
    return Noise(
        (max(scatter.accelerometer_output, accelerometer_output), _dof([one.accelerometer for one in every])),
        (max(at_rest_output, gyro_output), dof),
        max(_density(turned, floor), by_others),
        by_others,
    )


def _at_rest(fits: Sequence[GyroFit | None]) -> tuple[float, int] | None:
    """Scatter at rest over all attitudes: those with an axis vertical leave few degrees of freedom."""
    known = [fit for fit in fits if fit is not None]
    dof = sum(fit.dof for fit in known)
    return (float(np.sqrt(sum(fit.squares for fit in known) / dof)), dof) if dof else None


class Across(NamedTuple):
    """Readings of a gyro during rotation about another axis, (r,): rates in °/s, durations, and output.

    `quantisation_u` is the quantisation uncertainty of each.
    """

    rate_dps: Array
    span_s: Array
    output: Array
    quantisation_u: Array


def about_another(axis: int, other: int, unit: UnitUnderTest, visit: Visit) -> Across:
    """Good readings of a gyro during rotation about another axis."""
    turned = visit.turned(other)
    windows = [each.acquisition.windows[unit.channels[f"gyro_{AXES[axis]}"]] for each in turned]
    rows = np.array(
        [(each.rate_dps, of.span_s, of.mean, of.quantisation_u) for each, of in zip(turned, windows, strict=True)]
    ).reshape(-1, 4)
    return Across(*rows[np.isfinite(rows).all(axis=-1)].T)


def _density(readings: Iterable[tuple[Array, Array, Array]], floor: float) -> tuple[float, int]:
    """Density pooled over several lines through readings (rates, durations, outputs); at least the floor.

    The part even in the rate is removed: a gyro's asymmetry is no scatter, and does not tilt a line.
    """
    squares, dof = 0.0, 0
    for rate_dps, span_s, output in readings:
        weights = np.sqrt(span_s)
        columns = np.stack([np.ones_like(rate_dps), rate_dps, np.abs(rate_dps)], axis=-1)
        with suppress(NotDetermined):
            fit = least_squares(columns * weights[:, np.newaxis], output * weights)
            squares, dof = squares + float(np.sum(fit.residuals**2)), dof + fit.dof
    return (max(float(np.sqrt(squares / dof)), floor), dof) if dof else (0.0, 0)


def _alone(channel: str, visits: Sequence[Visit]) -> float:
    """Median single-reading uncertainty of a channel at rest."""
    windows = [each.acquisition.windows[channel] for visit in visits for each in visit.at_rest]
    return _usual([window.single_u for window in windows])


def _alone_density(channel: str, visits: Sequence[Visit]) -> float:
    """The same during rotation, as a density."""
    windows = [each.acquisition.windows[channel] for visit in visits for each in visit.turning]
    return _usual([window.single_u * window.span_s**0.5 for window in windows])


def _usual(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else 0.0


def _dof(fits: Sequence[LinearFit]) -> int:
    return sum(fit.dof for fit in fits)
