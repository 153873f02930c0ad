"""Readings of an inertial unit in 24 attitudes and at six rates, brought from rows into arrays (methods.md 4.3, 4.7, 9).

A row whose counts, dwell or place in the schedule is missing is passed over, and of several rows of one position the
last good one counts, so that an operator can repeat what went wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.attitudes import AXES, BLOCK, NAMES
from bench.analysis.fit import Array

RATES = 6
SAME_SET_POINT_DIGITS = 6


@dataclass(frozen=True, slots=True)
class PositionRecord:
    """One row per dwell at rest, in the order of acquisition; a missing number is NaN.

    `attitude` (n,) counts from 0 in the order of `attitudes.NAMES`, -1 where it is missing. Counts are net pulses of x, y
    and z in the dwell (n, 3), temperatures those of the thermometers at the accelerometers and at the gyros (n, 3).
    """

    set_c: Array
    attitude: NDArray[np.int_]
    dwell_s: Array
    accelerometer_counts: Array
    gyro_counts: Array
    accelerometer_c: Array
    gyro_c: Array


@dataclass(frozen=True, slots=True)
class RateRecord:
    """One row per dwell at a constant rate about one axis, in the order of acquisition; a missing number is NaN.

    `axis` (n,) is 0, 1 or 2, -1 where it is missing; `rate_dps` is what the table's encoder measured; the rest is as in
    a PositionRecord.
    """

    set_c: Array
    axis: NDArray[np.int_]
    command_dps: Array
    rate_dps: Array
    dwell_s: Array
    gyro_counts: Array
    accelerometer_c: Array
    gyro_c: Array


@dataclass(frozen=True, slots=True)
class ImuReadings:
    """Readings by set point (m, hottest first), attitude (24) and axis (3); NaN where there is none.

    Those at rates are by set point, axis that was turned, and commanded rate (r); they are of the turned axis alone.
    `excluded` counts what was left out: rows by `missing`, `duplicate` (an earlier row of the same position or rate) and
    `rate` (the table did not turn as it was told).
    """

    set_c: Array
    accelerometer_pps: Array
    gyro_pps: Array
    accelerometer_c: Array
    gyro_c: Array
    rate_dps: Array
    rate_pps: Array
    rate_accelerometer_c: Array
    rate_gyro_c: Array
    excluded: Mapping[str, int]

    def temperatures_c(self, point: int, axis: int) -> tuple[Array, Array]:
        """Both thermometers of one axis while that axis was calibrated: eight attitudes, then the rates."""
        own = slice(axis * BLOCK, (axis + 1) * BLOCK)
        return (
            np.concatenate([self.accelerometer_c[point, own, axis], self.rate_accelerometer_c[point, axis]]),
            np.concatenate([self.gyro_c[point, own, axis], self.rate_gyro_c[point, axis]]),
        )


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def arrange(positions: PositionRecord, rates: RateRecord, *, rate_tolerance: float) -> ImuReadings:
    """The rows as arrays; `rate_tolerance` is how far, relative to the command, the table's rate may be off."""
    position_set_c, rate_set_c = _rounded(positions.set_c), _rounded(rates.set_c)
    every_set_c = np.concatenate([position_set_c, rate_set_c])
    set_c = np.unique(every_set_c[np.isfinite(every_set_c)])
    excluded: Counter[str] = Counter(missing=0, duplicate=0, rate=0)
    at_rest = _at_rest(positions, np.searchsorted(set_c, position_set_c), len(set_c), excluded)
    turning = _turning(rates, np.searchsorted(set_c, rate_set_c), len(set_c), rate_tolerance, excluded)
    by_descending = slice(None, None, -1)
    return ImuReadings(set_c[::-1], *(part[by_descending] for part in (*at_rest, *turning)), dict(excluded))


def _rounded(set_c: Array) -> Array:
    """Set points without the rounding of whoever wrote them, and without a zero below zero."""
    return np.asarray(np.round(set_c, SAME_SET_POINT_DIGITS) + 0.0)


def _at_rest(record: PositionRecord, point: NDArray[np.int_], points: int, excluded: Counter[str]) -> tuple[Array, ...]:
    """Rates of pulses and temperatures at rest: four arrays (points, 24, 3)."""
    dwell_s = np.where(record.dwell_s > 0, record.dwell_s, np.nan)[:, np.newaxis]
    accelerometer_pps, gyro_pps = record.accelerometer_counts / dwell_s, record.gyro_counts / dwell_s
    placed = np.isfinite(record.set_c) & (record.attitude >= 0)
    good = placed[:, np.newaxis] & np.isfinite(accelerometer_pps) & np.isfinite(gyro_pps)
    row, axis = np.nonzero(good)
    arrays = []
    for values in (accelerometer_pps, gyro_pps, record.accelerometer_c, record.gyro_c):
        array = np.full((points, len(NAMES), len(AXES)), np.nan)
        array[point[row], record.attitude[row], axis] = values[row, axis]  # of equal places the last row stays
        arrays.append(array)
    own_row = np.flatnonzero(good[np.arange(len(good)), record.attitude // BLOCK])
    excluded["missing"] += len(good) - len(own_row)
    excluded["duplicate"] += len(own_row) - _distinct(point[own_row], record.attitude[own_row])
    return tuple(arrays)


def _turning(
    record: RateRecord, point: NDArray[np.int_], points: int, tolerance: float, excluded: Counter[str]
) -> tuple[Array, ...]:
    """Rates, rates of pulses and temperatures while turning: four arrays (points, 3, commanded rates)."""
    own = (np.arange(len(record.axis)), record.axis)
    pps = record.gyro_counts[own] / np.where(record.dwell_s > 0, record.dwell_s, np.nan)
    given = np.isfinite(record.set_c) & np.isfinite(record.command_dps) & np.isfinite(record.rate_dps)
    present = given & (record.axis >= 0) & np.isfinite(pps)
    as_told = np.abs(record.rate_dps - record.command_dps) <= tolerance * np.abs(record.command_dps)
    row = np.flatnonzero(present & as_told)
    command_dps, command = np.unique(record.command_dps[row], return_inverse=True)
    arrays = []
    for values in (record.rate_dps, pps, record.accelerometer_c[own], record.gyro_c[own]):
        array = np.full((points, len(AXES), len(command_dps)), np.nan)
        array[point[row], record.axis[row], command] = values[row]  # of equal places the last row stays
        arrays.append(array)
    excluded["missing"] += int(np.sum(~present))
    excluded["rate"] += int(np.sum(present & ~as_told))
    excluded["duplicate"] += len(row) - _distinct(point[row], record.axis[row], command)
    return tuple(arrays)


def _distinct(*places: NDArray[np.int_]) -> int:
    """How many different places (n,) there are."""
    return len(np.unique(np.stack(places, axis=-1), axis=0))
