"""Calibration of an inertial unit at each temperature: zeros and scale factors of six channels (equations 4.4, 4.7).

Each axis is calibrated by the eight attitudes in which it is vertical and by six rates about it. The mean of the eight
is the zero, because gravity, earth rate and cross-coupling from the other axes cancel in it. The accelerometer's zero
contains K2, its scale factor K3.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitude_check import doubtful_attitudes, exchanged_headings
from bench.methods.imu.reduction.attitudes import NAMES, NORTH, SPECIFIC_FORCE_G, block
from bench.methods.imu.reduction.knots import TemperatureTable, temperature_table
from bench.methods.imu.reduction.records import ImuReadings, RateReadings
from bench.methods.imu.words import (
    FEW_TEMPERATURES,
    HEADINGS_UNKNOWN,
    INCONSISTENT,
    MISSING_POSITION,
    MISSING_RATE,
    NO_LATITUDE,
    NORTH_ELSEWHERE,
    THERMOMETER_APART,
)
from bench.metrology.least_squares import Array, LinearFit, NotDetermined, least_squares
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES
from bench.metrology.temperature_checks import broken_at_rest

RATES = 6  # +1, -1, +3, -3, +5 and -5 °/s, or others
DEG_PER_S_IN_DEG_PER_H = 3600.0


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviations in pulse/s of one reading about its fit, pooled over all set points of one axis."""

    accelerometer_output: float
    gyro_at_rest_output: float
    gyro_turning_output: float


@dataclass(frozen=True, slots=True)
class AxisUncertainty:
    """Standard uncertainties of the properties of the same names of an AxisCalibration, type A."""

    k0: float
    k1_per_g: float
    d0: float
    d0_dph: float
    kg_pulse_per_deg: float


@dataclass(frozen=True, slots=True)
class AxisCalibration:
    """One axis at one set point; a temperature is NaN when most readings of its thermometer are bad.

    Coefficients of the fits: `accelerometer` (zero, scale), `gyro_at_rest` (zero, and terms that change with the axis),
    `gyro_turning` (intercept, scale).
    """

    accelerometer_c: float
    gyro_c: float
    accelerometer: LinearFit
    gyro_at_rest: LinearFit
    gyro_turning: LinearFit

    def temperature_c(self, sensor: str) -> float:
        """Temperature by the thermometer of a sensor, acc or gyro."""
        return self.accelerometer_c if sensor == "acc" else self.gyro_c

    @property
    def k0(self) -> float:
        """Zero of the accelerometer in pulse/s."""
        return float(self.accelerometer.coefficients[0])

    @property
    def k1_per_g(self) -> float:
        """Scale factor of the accelerometer, per local g."""
        return float(self.accelerometer.coefficients[1])

    @property
    def d0(self) -> float:
        """Zero of the gyro in pulse/s."""
        return float(self.gyro_at_rest.coefficients[0])

    @property
    def kg_pulse_per_deg(self) -> float:
        """Scale factor of the gyro."""
        return float(self.gyro_turning.coefficients[1])

    @property
    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def d0_dph(self) -> float:
        """Zero of the gyro in °/h."""
        return float(DEG_PER_S_IN_DEG_PER_H * np.float64(self.d0) / self.kg_pulse_per_deg)

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def uncertainty(self, scatter: Scatter) -> AxisUncertainty:
        """Standard uncertainties from the scatter of the readings."""
        u_k0, u_k1 = scatter.accelerometer_output * np.linalg.norm(self.accelerometer.gain, axis=-1)
        u_d0 = scatter.gyro_at_rest_output * np.linalg.norm(self.gyro_at_rest.gain[0])
        u_kg = scatter.gyro_turning_output * np.linalg.norm(self.gyro_turning.gain[1])
        scale = np.float64(self.kg_pulse_per_deg)
        u_d0_dps = np.hypot(u_d0, self.d0 / scale * u_kg) / abs(scale)
        return AxisUncertainty(
            float(u_k0), float(u_k1), float(u_d0), float(DEG_PER_S_IN_DEG_PER_H * u_d0_dps), float(u_kg)
        )


@dataclass(frozen=True, slots=True)
class SetPoint:
    """The axes x, y and z at one visit of a temperature of the chamber; None where one could not be calibrated.

    `doubted` (24,) masks attitudes in which the unit seems to have had another one.
    """

    set_c: float
    axes: tuple[AxisCalibration | None, ...]
    doubted: NDArray[np.bool_]
    visit: int = 1

    @property
    def pulse_per_deg(self) -> Array:
        """Scale factors of the gyros (3,), NaN if unknown."""
        return np.array([axis.kg_pulse_per_deg if axis else math.nan for axis in self.axes])


@dataclass(frozen=True, slots=True)
class ImuCalibration:
    """Set points from hot to cold; `scatter` is that of x, y and z.

    `flags` are those of equations 4.7, `notes` are on problems without a flag; `excluded` counts rows and thermometer
    readings that were left out, by reason.
    """

    points: tuple[SetPoint, ...]
    scatter: tuple[Scatter, ...]
    flags: tuple[Flag, ...]
    notes: tuple[Flag, ...]
    excluded: Mapping[str, int]

    def over_temperature(self, axis: int) -> list[AxisCalibration]:
        """One axis at all set points where it could be calibrated."""
        return _calibrated(self.points, axis)

    def temperatures_c(self, sensor: str, axis: int) -> Array:
        """Temperatures (m,) of one channel where it could be calibrated; `sensor` is acc or gyro."""
        every = self.over_temperature(axis)
        read_c = np.array([one.temperature_c(sensor) for one in every], np.float64)
        return read_c[np.isfinite(read_c)]

    def knots(self, sensor: str, axis: int) -> TemperatureTable:
        """Knots of one channel over temperature; `sensor` is acc or gyro."""
        every = self.over_temperature(axis)
        if sensor == "acc":
            rows = [(one.accelerometer_c, one.k0, one.k1_per_g) for one in every]
        else:
            rows = [(one.gyro_c, one.d0, one.kg_pulse_per_deg) for one in every]
        return temperature_table(np.array(rows, np.float64).reshape(-1, 3))


def thermometers_apart(found: ImuCalibration, limit_c: float) -> Iterator[Flag]:
    """Sensors whose thermometer deviates from the median of its triad by more than a limit at a set point.

    A thermometer that came off reads the air. Two that are exchanged cannot be told: any temperature that follows the
    sensor's makes a smooth table.
    """
    calibrated = [[axis for axis in point.axes if axis] for point in found.points if all(point.axes)]
    for sensor in ("acc", "gyro"):
        read_c = np.array([[axis.temperature_c(sensor) for axis in axes] for axes in calibrated]).reshape(-1, len(AXES))
        apart_c = np.abs(read_c - np.median(read_c, axis=-1, keepdims=True))
        for axis, largest_c in zip(AXES, np.nan_to_num(apart_c).max(axis=0, initial=0.0).tolist(), strict=True):
            if largest_c > limit_c:
                yield Flag(THERMOMETER_APART, values={"sensor": f"{sensor}_{axis}", "apart": f"{largest_c:.1f}"})


def _calibrated(points: Sequence[SetPoint], axis: int) -> list[AxisCalibration]:
    return [found for point in points if (found := point.axes[axis]) is not None]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def calibrate(readings: ImuReadings, attitude_tolerance_g: float, latitude_deg: float | None = None) -> ImuCalibration:
    """Every axis at every set point.

    An axis lacks a set point, with a flag, where one of its eight attitudes or six rates is missing, or where one of
    its attitudes reads more than `attitude_tolerance_g` away from the median of its kind, up or down. With a latitude
    the headings are checked; exchanged ones do not change the means and get a note.
    """
    remarks = _Remarks(excluded=Counter({**readings.excluded, "thermometer": 0}))
    points = []
    for number, set_c in enumerate(readings.set_c):
        doubted = doubtful_attitudes(readings.accelerometer_output[number], attitude_tolerance_g)
        axes = tuple(_axis(readings, number, axis, doubted, remarks) for axis in range(len(AXES)))
        points.append(SetPoint(float(set_c), axes, doubted, int(readings.visit[number])))
    remarks.notes += _check_headings(readings, points, latitude_deg)
    scatter = tuple(_scatter(_calibrated(points, axis)) for axis in range(len(AXES)))
    return ImuCalibration(tuple(points), scatter, tuple(remarks.flags), tuple(remarks.notes), dict(remarks.excluded))


@dataclass(slots=True)
class _Remarks:
    """Flags, notes and exclusions collected from the readings."""

    excluded: Counter[str]
    flags: list[Flag] = field(default_factory=list)
    notes: list[Flag] = field(default_factory=list)


def _axis(
    readings: ImuReadings, point: int, axis: int, doubted: NDArray[np.bool_], remarks: _Remarks
) -> AxisCalibration | None:
    """Calibration of one axis at one set point; None if something is missing or contradictory."""
    set_c = f"{readings.set_c[point]:.10g}"
    problems = list(_problems(readings.accelerometer_output[point], axis, doubted))
    turning = _turning(readings.rates[point][axis])
    if turning is None:
        problems.append((MISSING_RATE, AXES[axis]))
    remarks.flags += [Flag(problem, values={"set_c": set_c, "what": what}) for problem, what in problems]
    if problems or turning is None:
        return None
    accelerometer_c, gyro_c = (_mean(told, remarks.excluded) for told in readings.temperatures_c(point, axis))
    for kind, celsius in (("acc", accelerometer_c), ("gyro", gyro_c)):
        if math.isnan(celsius):
            remarks.notes.append(Flag(FEW_TEMPERATURES, f"T={set_c}", values={"sensor": f"{kind}_{AXES[axis]}"}))
    return AxisCalibration(accelerometer_c, gyro_c, *_at_rest(readings, point, axis), turning)


def _problems(accelerometer_output: Array, axis: int, doubted: NDArray[np.bool_]) -> Iterator[tuple[str, str]]:
    """Problems of the eight attitudes of an axis, each with its attitude; readings are (24, 3), of one set point."""
    own = range(len(NAMES))[block(axis)]
    yield from ((MISSING_POSITION, NAMES[i]) for i in own if np.isnan(accelerometer_output[i, axis]))
    yield from ((INCONSISTENT, NAMES[i]) for i in own if doubted[i])


def _at_rest(readings: ImuReadings, point: int, axis: int) -> tuple[LinearFit, LinearFit]:
    """Fit accelerometer and gyro of one axis over its eight attitudes.

    All columns are orthogonal: the first coefficient is the mean, the accelerometer's second is half the difference
    between up and down. The horizontal earth rate, which a misaligned gyro senses depending on its heading, has its own
    columns, so that the scatter about the fit is that of the readings.
    """
    own = block(axis)
    one, up = np.ones(own.stop - own.start), SPECIFIC_FORCE_G[own, axis]
    north = NORTH[own, [other for other in range(len(AXES)) if other != axis]]
    accelerometer = least_squares(np.stack([one, up], axis=-1), readings.accelerometer_output[point, own, axis])
    return accelerometer, least_squares(np.column_stack([one, up, north]), readings.gyro_output[point, own, axis])


def _turning(readings: RateReadings) -> LinearFit | None:
    """Fit the gyro against the table's rate; None if rates are missing, or do not determine a line."""
    if len(readings.rate_dps) < RATES:
        return None
    try:
        return least_squares(
            np.stack([np.ones_like(readings.rate_dps), readings.rate_dps], axis=-1), readings.gyro_output
        )
    except NotDetermined:
        return None


def _check_headings(readings: ImuReadings, points: list[SetPoint], latitude_deg: float | None) -> Iterator[Flag]:
    """Add exchanged headings to the doubted attitudes; return notes on them."""
    if latitude_deg is None:
        yield Flag(NO_LATITUDE)
        return
    untold = 0
    for number, point in enumerate(points):
        exchanged, unclear = exchanged_headings(readings.gyro_output[number], point.pulse_per_deg, latitude_deg)
        untold += len(unclear)
        if exchanged:
            point.doubted[exchanged] = True
            names = ", ".join(NAMES[i] for i in exchanged)
            yield Flag(NORTH_ELSEWHERE, f"T={point.set_c:.10g}", values={"axes": names})
    if untold:
        yield Flag(HEADINGS_UNKNOWN, values={"untold": untold, "count": len(points) * len(NAMES)})


def _scatter(calibrated: Sequence[AxisCalibration]) -> Scatter:
    """Scatter of one axis at all its set points; NaN without any."""
    return Scatter(
        accelerometer_output=_pooled_sd([one.accelerometer for one in calibrated]),
        gyro_at_rest_output=_pooled_sd([one.gyro_at_rest for one in calibrated]),
        gyro_turning_output=_pooled_sd([one.gyro_turning for one in calibrated]),
    )


def _pooled_sd(fits: Sequence[LinearFit]) -> float:
    """Standard deviation of one reading about the fits, over all of them."""
    squares = np.sum([np.sum(fit.residuals**2) for fit in fits])
    return float(np.sqrt(squares / sum(fit.dof for fit in fits)))


def _mean(temperature_c: Array, excluded: Counter[str]) -> float:
    """Mean of the good readings (n,) of a thermometer; NaN if they are fewer than half."""
    good = temperature_c[np.isfinite(temperature_c)]
    good = good[~broken_at_rest(good)]
    excluded["thermometer"] += len(temperature_c) - len(good)
    return float(np.mean(good)) if 2 * len(good) >= len(temperature_c) else math.nan
