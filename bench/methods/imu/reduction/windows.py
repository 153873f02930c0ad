"""Readings of an inertial unit from the windows of a run, by visits of set points (equations 4.3).

The attitude of a window, or the axis of its rotation, follows from the read-back angles of the table and from the
mount, not from names in the sequence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitudes import BLOCK, BODY_AXES
from bench.methods.imu.reduction.records import ImuReadings, PositionRecord, RateRecord, arranged_at
from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.orientation import rotation, unit_axes
from bench.metrology.run_data import AXES, RunData, UnitUnderTest

ACCELEROMETERS, GYROS = (tuple(f"{sensor}_{axis}" for axis in AXES) for sensor in ("acc", "gyro"))
ALIGNED = 0.999  # cosine of the largest deviation of an axis from its direction in an attitude
SAME_SET_POINT_C = 0.5
LEAST_SHARE = 0.5  # minimum share of valid readings of a thermometer
SAME_CLOCK_S, SAME_CLOCK = 0.1, 1e-3  # largest difference of two clocks, absolute and relative, without a restart


@dataclass(frozen=True, slots=True)
class AtRest:
    """A window at rest, with its index among the 24 attitudes."""

    attitude: int
    acquisition: Acquisition


@dataclass(frozen=True, slots=True)
class Turning:
    """A window over whole turns about one axis of the unit, at a rate in °/s by the clock of its counter."""

    axis: int
    command_dps: float
    rate_dps: float
    acquisition: Acquisition


@dataclass(frozen=True, slots=True)
class Visit:
    """A visit of a set point, with the windows that can be assigned; `path` names it by its loops.

    `unplaced` are the steps of windows with no known attitude or axis.
    """

    number: int
    path: str
    set_c: float
    at_rest: tuple[AtRest, ...]
    turning: tuple[Turning, ...]
    unplaced: tuple[str, ...]

    @property
    def tail(self) -> str:
        """Last part of an id at this visit."""
        return f"@{self.path}" if self.path else ""

    @property
    def told_set_c(self) -> float | None:
        """Set point; None if there was none."""
        return None if np.isnan(self.set_c) else self.set_c

    @property
    def windows(self) -> list[Acquisition]:
        """Its windows at rest, then those of rotations."""
        return [*(each.acquisition for each in self.at_rest), *(each.acquisition for each in self.turning)]

    @property
    def attitudes(self) -> frozenset[int]:
        """Attitudes that were measured."""
        return frozenset(each.attitude for each in self.at_rest)

    def window_of(self, attitude: int) -> Acquisition | None:
        """Last window of an attitude; None without one."""
        return next((each.acquisition for each in reversed(self.at_rest) if each.attitude == attitude), None)

    def turned(self, axis: int) -> list[Turning]:
        """Windows with rotation about an axis."""
        return [each for each in self.turning if each.axis == axis]


def visits(data: RunData, unit: UnitUnderTest) -> list[Visit]:
    """Visits of set points in run order.

    Windows at a set point in another mount, because the table does not reach all attitudes in one, belong to the first
    visit there that lacks them.
    """
    found: list[Visit] = []
    for group, acquisitions in data.groups().items():
        visit = _visit(len(found), group, acquisitions, unit, data.bench)
        lacking = next((other for other in found if _completes(visit, other)), None)
        if lacking is None:
            found.append(visit)
        else:
            found[lacking.number] = replace(
                lacking,
                at_rest=lacking.at_rest + visit.at_rest,
                turning=lacking.turning + visit.turning,
                unplaced=lacking.unplaced + visit.unplaced,
            )
    return found


def _completes(visit: Visit, other: Visit) -> bool:
    """True if a visit supplies, in another mount, data that an earlier one at the same set point lacks."""
    mounts = [{each.acquisition.mount.name for each in of.at_rest} for of in (visit, other)]
    near = abs(visit.set_c - other.set_c) < SAME_SET_POINT_C or (np.isnan(visit.set_c) and np.isnan(other.set_c))
    return bool(near) and mounts[0].isdisjoint(mounts[1]) and visit.attitudes.isdisjoint(other.attitudes)


def _visit(
    number: int, group: str, acquisitions: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord
) -> Visit:
    at_rest, turning, unplaced = [], [], []
    clocks = {channel: _host_per_counter(acquisitions, channel) for channel in map(unit.channels.get, GYROS) if channel}
    for acquisition in acquisitions:
        axes = unit_axes(acquisition, unit, bench)
        turned = _turning(acquisition, axes, unit, bench, clocks)
        fits = np.einsum("kij,ij->ki", BODY_AXES, axes).min(axis=-1)
        if turned is not None:
            turning.append(turned)
        elif acquisition.turned is None and fits.max() > ALIGNED:
            at_rest.append(AtRest(int(np.argmax(fits)), acquisition))
        else:
            unplaced.append(acquisition.step)
    path = group.partition("/")[2]
    return Visit(number, path, acquisitions[0].set_c, tuple(at_rest), tuple(turning), tuple(unplaced))


def _host_per_counter(acquisitions: Sequence[Acquisition], channel: str) -> float | None:
    """Seconds of the host's clock per second of the counter's, by least squares over the windows of a visit.

    A single window is too short for the scatter of arrival times. None if the visit is not much longer than a window,
    if the counter has restarted in it, or if its clock wraps so often that a restart cannot be detected.
    """
    windows = [window for each in acquisitions if (window := each.windows.get(channel)) is not None]
    clocks = [window.clock for window in windows if window.clock is not None and not window.problems]
    if len(clocks) < 2:
        return None
    host_s, device_s = np.array([(clock.host_s, clock.device_s) for clock in clocks]).T
    passed_s, steps_s = np.diff(host_s), np.diff(device_s)
    steps_s += np.round((passed_s - steps_s) / clocks[0].wraps_s) * clocks[0].wraps_s
    allowed_s = SAME_CLOCK_S + SAME_CLOCK * passed_s
    is_unsure = (np.abs(steps_s - passed_s) > allowed_s).any() or 4 * allowed_s.max() > clocks[0].wraps_s
    if is_unsure or passed_s.sum() < 2 * max(window.span_s for window in windows):
        return None
    away_s = np.concatenate(([0.0], np.cumsum(steps_s)))
    away_s -= away_s.mean()
    return float(np.sum(away_s * (host_s - host_s[0])) / np.sum(away_s**2))


def _turning(
    acquisition: Acquisition, axes: Array, unit: UnitUnderTest, bench: BenchRecord, clocks: Mapping[str, float | None]
) -> Turning | None:
    """Rotation of a window; None if it is at rest, or not about an axis of the unit.

    The table's angles are timed by the host's clock; the rate is converted to the counter's clock, by `clocks` of the
    visit or else by the window. For a unit that sends samples of a rate it stays by the host's clock.
    """
    turned = acquisition.turned
    if turned is None or turned.to_s <= turned.from_s:
        return None
    along = axes @ axis_direction(acquisition, turned.axis, bench)
    axis = int(np.argmax(np.abs(along)))
    channel = unit.channels[GYROS[axis]]
    window = acquisition.windows.get(channel)
    if abs(along[axis]) < ALIGNED or window is None:
        return None
    clock = clocks.get(channel) or (window.host_span_s / window.span_s if window.span_s else np.nan)
    rate_dps = (turned.to_deg - turned.from_deg) / (turned.to_s - turned.from_s) * clock
    sign = float(np.sign(along[axis]))
    return Turning(axis, sign * turned.command_dps, sign * rate_dps, acquisition)


def axis_direction(acquisition: Acquisition, role: str, bench: BenchRecord) -> Array:
    """Direction of the positive end of a table axis in the level frame, as carried by the outer axes, (3,)."""
    turned = np.eye(3)
    for name, axis in bench.axes.items():
        if name == role:
            return turned @ axis.points
        turned = turned @ rotation(axis.points, math.radians(acquisition.angles_deg.get(name, 0.0)))
    return np.zeros(3)


def readings(found: Sequence[Visit], unit: UnitUnderTest, rate_tolerance: float) -> ImuReadings:
    """Readings of all visits, one entry of each array for each visit; a set point may be visited twice."""
    resting = [(visit.number, each) for visit in found for each in visit.at_rest]
    turned = [(visit.number, each) for visit in found for each in visit.turning]
    attitude = np.array([each.attitude for _, each in resting], dtype=np.int_)
    at_rest, turning = (_Windows([each.acquisition for _, each in part], unit) for part in (resting, turned))
    positions = PositionRecord(
        set_c=np.zeros(len(resting)),
        attitude=attitude,
        dwell_s=at_rest.span_s,
        accelerometer_counts=at_rest.counts(
            ACCELEROMETERS, may_be_silent=(attitude // BLOCK)[:, np.newaxis] != np.arange(len(AXES))
        ),
        gyro_counts=at_rest.counts(GYROS),
        accelerometer_c=at_rest.celsius(ACCELEROMETERS),
        gyro_c=at_rest.celsius(GYROS),
    )
    rates = RateRecord(
        set_c=np.zeros(len(turned)),
        axis=np.array([each.axis for _, each in turned], dtype=np.int_),
        command_dps=np.array([each.command_dps for _, each in turned]),
        rate_dps=np.array([each.rate_dps for _, each in turned]),
        dwell_s=turning.span_s,
        gyro_counts=turning.counts(GYROS),
        accelerometer_c=turning.celsius(ACCELEROMETERS),
        gyro_c=turning.celsius(GYROS),
    )
    of_position, of_rate = (np.array([number for number, _ in part], dtype=np.int_) for part in (resting, turned))
    arranged = arranged_at(len(found), positions, of_position, rates, of_rate, rate_tolerance)
    return replace(arranged, set_c=np.array([visit.set_c for visit in found]))


@dataclass(frozen=True, slots=True)
class _Windows:
    """Windows (n,) of a unit as counts, or as the equivalent of mean codes."""

    acquisitions: Sequence[Acquisition]
    unit: UnitUnderTest

    @property
    def span_s(self) -> Array:
        """Duration of each: (n,)."""
        channels = self.unit.channels.values()
        return np.array(
            [max((each.windows[name].span_s for name in channels), default=0.0) for each in self.acquisitions]
        )

    def counts(self, sensors: Sequence[str], may_be_silent: NDArray[np.bool_] | None = None) -> Array:
        """Counts of three sensors (n, 3); those that may not be silent have none in a dead band, gyros always may."""
        shape = (len(self.acquisitions), len(AXES))
        silent = np.full(shape, True) if may_be_silent is None else may_be_silent
        means = [
            [_mean(each, self.unit.channels[name], may) for name, may in zip(sensors, of, strict=True)]
            for each, of in zip(self.acquisitions, silent, strict=True)
        ]
        return np.asarray(np.array(means).reshape(shape) * self.span_s[:, np.newaxis])

    def celsius(self, sensors: Sequence[str]) -> Array:
        """Temperatures at three sensors (n, 3), each by its own thermometer."""
        names = [self.unit.thermometer(sensor) for sensor in sensors]
        means = [[mean_c(each, name) for name in names] for each in self.acquisitions]
        return np.array(means, np.float64).reshape(-1, len(AXES))


def _mean(acquisition: Acquisition, channel: str, may_be_silent: np.bool_) -> float:
    """Mean output of a channel in its window; NaN if it cannot be used."""
    window = acquisition.windows[channel]
    return np.nan if set(window.problems) - ({"dead_band"} if may_be_silent else set()) else window.mean


def mean_c(acquisition: Acquisition, reading: str) -> float:
    """Mean of a reading during an acquisition; NaN if fewer than half of its values are good."""
    values = acquisition.temperatures_c.get(reading, np.empty(0))
    good = values[np.isfinite(values)]
    return float(good.mean()) if len(good) and len(good) >= LEAST_SHARE * len(values) else np.nan
