"""Readings of an inertial unit in 24 attitudes and at six rates, from rows to arrays (equations 4.3, 4.7, 9).

A row whose counts, dwell or place in the schedule is missing is passed over, and of several rows of one position in one
visit the last good one counts, so that an operator can repeat a failed one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitudes import BLOCK, NAMES, block
from bench.metrology.least_squares import Array
from bench.metrology.run_data import AXES

SAME_SET_POINT_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellRecord:
    """One row per dwell, in the order of acquisition; a missing number is NaN.

    Counts are net pulses of x, y and z in the dwell (n, 3), temperatures those of the thermometers at the
    accelerometers and at the gyros (n, 3). `visit` (n,) numbers the visits of each set point; without it there is one
    of each.
    """

    set_c: Array
    dwell_s: Array
    gyro_counts: Array
    accelerometer_c: Array
    gyro_c: Array
    visit: NDArray[np.int_] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionRecord(DwellRecord):
    """Dwells at rest; `attitude` (n,) counts from 0 in the order of `attitudes.NAMES`, -1 if missing."""

    attitude: NDArray[np.int_]
    accelerometer_counts: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class RateRecord(DwellRecord):
    """Dwells at a constant rate about one axis: `axis` (n,) is 0, 1 or 2, -1 if missing.

    `rate_dps` is the rate by the table's encoder.
    """

    axis: NDArray[np.int_]
    command_dps: Array
    rate_dps: Array


@dataclass(frozen=True, slots=True)
class RateReadings:
    """Readings of one axis during rotation, one per commanded rate, with durations; arrays (r,)."""

    rate_dps: Array
    dwell_s: Array
    gyro_output: Array
    accelerometer_c: Array
    gyro_c: Array


@dataclass(frozen=True, slots=True)
class ImuReadings:
    """Readings at rest by visit (m, hottest set point first), attitude (24) and axis (3), NaN if missing.

    `rates` are those of each visit and axis, `visit` (m,) its number at its set point. `excluded` counts the rows
    left out: `missing`, `duplicate` (a position or rate was repeated later in the visit), `rate` (the table did not
    turn at the commanded rate).
    """

    set_c: Array
    accelerometer_output: Array
    gyro_output: Array
    accelerometer_c: Array
    gyro_c: Array
    rates: tuple[tuple[RateReadings, ...], ...]
    excluded: Mapping[str, int]
    visit: NDArray[np.int_]

    def temperatures_c(self, point: int, axis: int) -> tuple[Array, Array]:
        """Temperatures of accelerometer and gyro of one axis in its calibration: eight attitudes, then the rates."""
        own, turned = (point, block(axis), axis), self.rates[point][axis]
        return (
            np.concatenate([self.accelerometer_c[own], turned.accelerometer_c]),
            np.concatenate([self.gyro_c[own], turned.gyro_c]),
        )


@np.errstate(over="ignore", invalid="ignore")
def arrange(positions: PositionRecord, rates: RateRecord, *, rate_tolerance: float) -> ImuReadings:
    """Arrange rows in arrays; `rate_tolerance` is the maximum relative deviation of the table's rate."""
    keys = np.concatenate([_keys(positions), _keys(rates)])
    placed = np.isfinite(keys).all(axis=-1)
    visits, point = np.unique(keys[placed], axis=0, return_inverse=True)
    points = np.full(len(keys), len(visits))
    points[placed] = point.ravel()
    of_position, of_rate = np.split(points, [len(positions.set_c)])
    found = arranged_at(len(visits), positions, of_position, rates, of_rate, rate_tolerance)
    return replace(found, set_c=-visits[:, 0] + 0.0, visit=visits[:, 1].astype(np.int_))


def arranged_at(
    points: int, positions: PositionRecord, of_position: NDArray[np.int_], rates: RateRecord, of_rate: NDArray[np.int_],
    rate_tolerance: float,
) -> ImuReadings:  # fmt: skip
    """Arrange rows (n,) by the numbers of their visits, `points` for none; a visit without rows has no readings.

    Set points are left to the caller.
    """
    excluded: Counter[str] = Counter(missing=0, duplicate=0, rate=0)
    at_rest = _at_rest(positions, of_position, points, excluded)
    turning = _turning(rates, of_rate, points, rate_tolerance, excluded)
    return ImuReadings(np.full(points, np.nan), *at_rest, turning, dict(excluded), np.arange(1, points + 1))


def _keys(record: DwellRecord) -> Array:
    """Sort keys of the visits of the rows (n, 2): the hottest set point first, then the number of the visit."""
    visit = np.ones(len(record.set_c)) if record.visit is None else record.visit.astype(np.float64)
    return np.stack([-rounded(record.set_c), visit], axis=-1)


def rounded(set_c: Array) -> Array:
    """Set points without rounding errors, and without a negative zero."""
    return np.asarray(np.round(set_c, SAME_SET_POINT_DIGITS) + 0.0)


def _at_rest(
    record: PositionRecord, point: NDArray[np.int_], points: int, excluded: Counter[str]
) -> tuple[Array, Array, Array, Array]:
    """Pulses per second and temperatures at rest: four arrays (points, 24, 3)."""
    dwell_s = np.where(record.dwell_s > 0, record.dwell_s, np.nan)[:, np.newaxis]
    accelerometer_output, gyro_output = record.accelerometer_counts / dwell_s, record.gyro_counts / dwell_s
    placed = (point < points) & (record.attitude >= 0)
    good = placed[:, np.newaxis] & np.isfinite(accelerometer_output) & np.isfinite(gyro_output)
    row, axis = np.nonzero(good)

    def by_place(values: Array) -> Array:
        array = np.full((points, len(NAMES), len(AXES)), np.nan)
        array[point[row], record.attitude[row], axis] = values[row, axis]  # of one position the last row counts
        return array

    vertical = good[np.arange(len(good)), record.attitude // BLOCK]
    excluded["missing"] += int(np.sum(~vertical))
    excluded["duplicate"] += int(np.sum(vertical)) - len(_last_of_each(point[vertical], record.attitude[vertical]))
    return (
        by_place(accelerometer_output),
        by_place(gyro_output),
        by_place(record.accelerometer_c),
        by_place(record.gyro_c),
    )


def _turning(
    record: RateRecord, point: NDArray[np.int_], points: int, tolerance: float, excluded: Counter[str]
) -> tuple[tuple[RateReadings, ...], ...]:
    """Readings of the rotated axis, by set point and axis."""
    own = (np.arange(len(record.axis)), record.axis)
    output = record.gyro_counts[own] / np.where(record.dwell_s > 0, record.dwell_s, np.nan)
    given = (point < points) & np.isfinite(record.command_dps) & np.isfinite(record.rate_dps)
    present = given & (record.axis >= 0) & np.isfinite(output)
    as_told = np.abs(record.rate_dps - record.command_dps) <= tolerance * np.abs(record.command_dps)
    used = np.flatnonzero(present & as_told)
    rows = used[_last_of_each(point[used], record.axis[used], record.command_dps[used])]
    excluded["missing"] += int(np.sum(~present))
    excluded["rate"] += int(np.sum(present & ~as_told))
    excluded["duplicate"] += len(used) - len(rows)
    place = point[rows] * len(AXES) + record.axis[rows]
    members = np.split(rows, np.searchsorted(place, np.arange(1, points * len(AXES))))
    readings = [
        RateReadings(
            record.rate_dps[of], record.dwell_s[of], output[of], record.accelerometer_c[own][of], record.gyro_c[own][of]
        )
        for of in members
    ]
    return tuple(tuple(readings[i * len(AXES) : (i + 1) * len(AXES)]) for i in range(points))


def _last_of_each(*places: NDArray[np.int_] | Array) -> NDArray[np.int_]:
    """Indices of the last row of each place, in the order of the places; all arrays (n,)."""
    place = np.stack(places, axis=-1)[::-1]
    return len(place) - 1 - np.unique(place, axis=0, return_index=True)[1]
