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
from typing import NamedTuple

import numpy as np

from bench.methods.imu.reduction.attitude_fit import GyroFit
from bench.methods.imu.reduction.attitudes import AXES
from bench.methods.imu.reduction.calibrate import ImuCalibration
from bench.methods.imu.reduction.records import ImuReadings
from bench.methods.imu.reduction.windows import Visit
from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares
from bench.metrology.run_data import UnitUnderTest


@dataclass(frozen=True, slots=True)
class Noise:
    """The scatter about their fits of the readings of one axis, pooled over the run, with its degrees of freedom.

    At rest it is the standard deviation of a reading in the unit of the output. While turned, about its own axis and
    about the others, it is the density in that unit times √s: over the root of its length in s, the standard deviation
    of a reading.
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

    A reading is not believed to scatter less than what it alone tells: equal counts in equal windows show nothing of
    what the count resolves, and samples have their own scatter. About its own axis a gyro's scatter holds that of the
    table's rate, about the others hardly anything of it: the six rates of a visit tell a standard deviation badly,
    which is therefore no less than what the others tell.
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
    """Of a reading at rest, over all attitudes: those in which an axis is vertical leave few degrees of freedom."""
    known = [fit for fit in fits if fit is not None]
    dof = sum(fit.dof for fit in known)
    return (float(np.sqrt(sum(fit.squares for fit in known) / dof)), dof) if dof else None


class Across(NamedTuple):
    """What a gyro read while another axis was turned, (r,): at which rates in °/s, for how long, and its output.

    `step_u` is what the steps of codes hide from each.
    """

    rate_dps: Array
    span_s: Array
    output: Array
    step_u: Array


def about_another(axis: int, other: int, unit: UnitUnderTest, visit: Visit) -> Across:
    """The readings of a gyro while another axis was turned; only good ones."""
    turned = visit.turned(other)
    windows = [each.acquisition.windows[unit.channels[f"gyro_{AXES[axis]}"]] for each in turned]
    rows = np.array(
        [(each.rate_dps, of.span_s, of.mean, of.step_u) for each, of in zip(turned, windows, strict=True)]
    ).reshape(-1, 4)
    return Across(*rows[np.isfinite(rows).all(axis=-1)].T)


def _density(readings: Iterable[tuple[Array, Array, Array]], floor: float) -> tuple[float, int]:
    """Pooled over several lines through readings: rates, for how long, and outputs; it is at least the floor.

    What is even in the rate is taken away: a gyro's asymmetry scatters nothing, and turns no line.
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
    """What the usual window of a channel at rest tells alone of its uncertainty."""
    windows = [each.acquisition.windows[channel] for visit in visits for each in visit.at_rest]
    return _usual([window.alone_u for window in windows])


def _alone_density(channel: str, visits: Sequence[Visit]) -> float:
    """The same while it is turned, as a density."""
    windows = [each.acquisition.windows[channel] for visit in visits for each in visit.turning]
    return _usual([window.alone_u * window.span_s**0.5 for window in windows])


def _usual(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else 0.0


def _dof(fits: Sequence[LinearFit]) -> int:
    return sum(fit.dof for fit in fits)
