"""Cases of method M2: an inertial unit calibrated over temperature and compensated (equations 4 and 9).

Beside the published keys stand `u`, which repeats `table` and `ls24` with standard uncertainties (type A), and the
regressed outputs of `apply` with those of their differences from the nominal temperature; and `model_check`, the
interpolation error of the knots of each channel.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.errors import InputError
from bench.methods.imu import doubts
from bench.methods.imu.offline_applied import apply
from bench.methods.imu.offline_visits import COMPENSATED, check_set_points, repeatability, with_visits
from bench.methods.imu.reduction.attitude_fit import AccelerometerFit, AttitudeFits, GyroFit, fit_attitudes
from bench.methods.imu.reduction.attitudes import NAMES
from bench.methods.imu.reduction.calibrate import AxisCalibration, ImuCalibration, Scatter, calibrate
from bench.methods.imu.reduction.knots import Extrapolation, TemperatureTable, check_model
from bench.methods.imu.reduction.records import ImuReadings, PositionRecord, RateRecord, arrange
from bench.methods.imu.words import INCONSISTENT, MISSING_POSITION, MISSING_RATE
from bench.metrology.least_squares import Array
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES
from bench.offline.case_file import Case, Limit, LocalGravity, Reduction, Reductions, Settings
from bench.offline.csv_record import Table

POSITIONS = "T_set_C,pos,dwell_s,Nx,Ny,Nz,Wx,Wy,Wz,Tax,Tay,Taz,Tgx,Tgy,Tgz"
RATES = "T_set_C,axis,rate_cmd_dps,rate_true_dps,dwell_s,Wx,Wy,Wz,Tax,Tay,Taz,Tgx,Tgy,Tgz"
THERMOMETERS = ("Tax", "Tay", "Taz", "Tgx", "Tgy", "Tgz")
CALIBRATED = ("K0_pps", "K1_pps_per_g", "D0_pps", "D0_dph", "KG_p_per_deg")
SAME_SET_POINT_C = 1e-6
NAMES_SHOWN = 5  # unknown positions in a note


class ImuSettings(Settings):
    """Settings of a case of M2; scale factors are per local g, so that its value does not enter the reduction."""

    nominal_c: float | None = Field(None, alias="T_nominal_C", ge=-273.15, le=1000)
    local_g_mps2: LocalGravity | None = Field(None, alias="g_mps2")
    extrapolation: Extrapolation = "hold"
    attitude_tolerance_g: float = Field(0.05, alias="attitude_tol_g", gt=0)
    # a larger difference belongs to another unit, or to the command of another row
    rate_tolerance: Limit = Field(0.5, alias="rate_tol")
    least_squares_set_c: float | None = Field(None, alias="ls24_T_set_C")


def _imu(case: Case) -> dict[str, Any]:
    settings, site = case.settings(ImuSettings), case.site
    at_rest, turned = case.record("positions", POSITIONS, optional="visit"), _rate_rows(case)
    positions, rates = with_visits(_positions(at_rest), _rates(turned), at_rest, turned)
    check_set_points(case, positions, rates)
    readings = arrange(positions, rates, rate_tolerance=settings.rate_tolerance)
    found = calibrate(readings, settings.attitude_tolerance_g, site.latitude_deg)
    fits, no_fits = _fits(case, settings.least_squares_set_c, site.latitude_deg, readings, found)
    tables = {f"{sensor}_{name}": found.knots(sensor, axis) for sensor in COMPENSATED for axis, name in enumerate(AXES)}
    applied = apply(case, settings.nominal_c, settings.extrapolation, found, tables)
    return {
        "table": _table(found, lambda axis, _: _calibrated(axis)),
        "apply": applied.rows,
        "ls24": fits and _by_axis(fits, _accelerometer, _gyro),
        "u": {
            "table": _table(found, _u_calibrated),
            "ls24": fits and _by_axis(fits, _u_accelerometer, _u_gyro),
            "apply": applied.u,
        },
        "repeatability": repeatability(found, tables, _calibrated),
        "model_check": {name: _model_check(name.split("_")[0], table) for name, table in tables.items()},
        "flags": [*found.flags, *([Flag("ill_conditioned")] if fits and fits.notes else [])],
        "notes": [
            *found.notes, *(fits.notes if fits else no_fits), *applied.notes, *_copies(at_rest, turned),
            *_unknown_positions(at_rest),
        ],
        "rejected": found.excluded,
        "doubts": doubts.unit(
            np.concatenate([positions.dwell_s, rates.dwell_s]), rates.command_dps, rates.rate_dps,
            {name: at_rest.numbers(name) for name in THERMOMETERS},
            _scales(found),
        ),
    }  # fmt: skip


def _scales(found: ImuCalibration) -> list[tuple[str, str, float]]:
    """Scale factors of every axis at every set point, by their keys and axes."""
    return [
        (key, name, value)
        for point in found.points
        for name, axis in zip(AXES, point.axes, strict=True)
        if axis
        for key, value in _calibrated(axis).items()
    ]


def _positions(table: Table) -> PositionRecord:
    return PositionRecord(
        set_c=table.numbers("T_set_C"),
        attitude=_numbers([text.strip().lower() for text in table.columns["pos"]], NAMES),
        dwell_s=table.numbers("dwell_s"),
        accelerometer_counts=_triple(table, "N"),
        gyro_counts=_triple(table, "W"),
        accelerometer_c=_triple(table, "Ta"),
        gyro_c=_triple(table, "Tg"),
    )


def _rates(table: Table) -> RateRecord:
    return RateRecord(
        set_c=table.numbers("T_set_C"),
        axis=_which(table, "axis", AXES),
        command_dps=table.numbers("rate_cmd_dps"),
        rate_dps=table.numbers("rate_true_dps"),
        dwell_s=table.numbers("dwell_s"),
        gyro_counts=_triple(table, "W"),
        accelerometer_c=_triple(table, "Ta"),
        gyro_c=_triple(table, "Tg"),
    )


def _rate_rows(case: Case) -> Table:
    """The record `rates`; without rows if the case has none."""
    columns = [*RATES.split(","), "visit"]
    return (
        case.record("rates", RATES, optional="visit")
        if case.has("rates")
        else Table("", dict.fromkeys(columns, ()), "")
    )


def _unknown_positions(table: Table) -> list[str]:
    """Notes on rows whose position is none of the 24; they count as missing."""
    known = {"", *(name.lower() for name in NAMES)}
    strangers = Counter(text.strip()[:40] for text in table.columns["pos"] if text.strip().lower() not in known)
    named = ", ".join(f"'{name}'" for name in list(strangers)[:NAMES_SHOWN])
    more = f" and {len(strangers) - NAMES_SHOWN} more" if len(strangers) > NAMES_SHOWN else ""
    rows = strangers.total()
    return [f"{table.file}: rows of unknown positions were ignored, {rows}: {named}{more}"] if rows else []


def _copies(*tables: Table) -> Iterator[str]:
    """Notes on duplicate rows: rows of two visits of a set point are never equal in every cell."""
    for table in tables:
        if count := table.without_copies()[1]:
            yield (
                f"{table.file}: rows that are equal to an earlier one in every cell, {count}; they were not left out: "
                "see whether a visit was pasted twice"
            )


def _which(table: Table, column: str, known: Sequence[str]) -> NDArray[np.int_]:
    """Indices in `known` of the words of a column (n,), -1 for a blank."""
    return _numbers(table.words(column, [name.lower() for name in known]).tolist(), known)


def _numbers(words: Sequence[str], known: Sequence[str]) -> NDArray[np.int_]:
    """Indices in `known` of words (n,), -1 for unknown ones."""
    number = {name.lower(): i for i, name in enumerate(known)}
    return np.array([number.get(word, -1) for word in words], dtype=np.int_)


def _triple(table: Table, name: str) -> Array:
    """Columns of x, y and z: (n, 3)."""
    return np.stack([table.numbers(f"{name}{axis}") for axis in AXES], axis=-1)


def _table(found: ImuCalibration, show: Callable[[AxisCalibration, Scatter], dict[str, float]]) -> list[dict[str, Any]]:
    """Result of `show` for each axis, one entry for each set point."""
    return [
        {"T_set_C": point.set_c, "visit": point.visit}
        | {
            name: axis and show(axis, scatter)
            for name, axis, scatter in zip(AXES, point.axes, found.scatter, strict=True)
        }
        for point in found.points
    ]


def _calibrated(axis: AxisCalibration) -> dict[str, float]:
    values = (axis.k0, axis.k1_per_g, axis.d0, axis.d0_dph, axis.kg_pulse_per_deg)
    temperatures = {"Ta_C": axis.accelerometer_c, "Tg_C": axis.gyro_c}
    return temperatures | dict(zip(CALIBRATED, values, strict=True))


def _u_calibrated(axis: AxisCalibration, scatter: Scatter) -> dict[str, float]:
    return dict(zip(CALIBRATED, astuple(axis.uncertainty(scatter)), strict=True))


def _fits(
    case: Case, set_c: float | None, latitude_deg: float | None, readings: ImuReadings, found: ImuCalibration
) -> tuple[AttitudeFits | None, tuple[str, ...]]:
    """Fits over the attitudes at `set_c`, without doubtful attitudes; None with the reason if not possible."""
    if set_c is None:
        return None, ()
    if latitude_deg is None:
        raise InputError(f"{case.name}: site.lat_deg: is missing; ls24 needs the earth rate")
    near = np.flatnonzero(np.abs(readings.set_c - set_c) < SAME_SET_POINT_C)  # the first visit of the set point
    if not len(near):
        known = ", ".join(f"{known_c:.10g}" for known_c in readings.set_c) or "none"
        return None, (f"ls24_T_set_C: there is no set point {set_c:.10g}; there are: {known}",)
    point = found.points[near[0]]
    left_out = point.doubted[:, np.newaxis]
    accelerometer_output, gyro_output = (
        np.where(left_out, np.nan, output[near[0]]) for output in (readings.accelerometer_output, readings.gyro_output)
    )
    return fit_attitudes(accelerometer_output, gyro_output, latitude_deg, point.pulse_per_deg), ()


def _by_axis(
    fits: AttitudeFits,
    accelerometer: Callable[[AccelerometerFit | None], dict[str, Any]],
    gyro: Callable[[GyroFit | None], dict[str, Any]],
) -> dict[str, Any]:
    return {
        name: accelerometer(acc_fit) | gyro(gyro_fit)
        for name, acc_fit, gyro_fit in zip(AXES, fits.accelerometers, fits.gyros, strict=True)
    }


def _accelerometer(found: AccelerometerFit | None) -> dict[str, Any]:
    return {
        "K0_g": found and found.k0_g,
        "K1_pps_per_g": found and found.k1_per_g,
        "K2_g_per_g2": found and found.k2_g_per_g2,
        "mis": found.misalignment_rad if found else 3 * [None],
    }


def _u_accelerometer(found: AccelerometerFit | None) -> dict[str, Any]:
    u = found.u if found else np.full(6, np.nan)
    return {"K0_g": u[0], "K1_pps_per_g": u[1], "K2_g_per_g2": u[2], "mis": u[3:]}


def _gyro(found: GyroFit | None) -> dict[str, Any]:
    return {
        "gyro_D0_pps": found and found.d0,
        "gyro_gsens_pps_per_g": found.g_sensitivity_per_g if found else 3 * [None],
    }


def _u_gyro(found: GyroFit | None) -> dict[str, Any]:
    return {
        "gyro_D0_pps": found and found.u_d0,
        "gyro_gsens_pps_per_g": found.u_g_sensitivity_per_g if found else 3 * [None],
    }


def _model_check(sensor: str, table: TemperatureTable) -> dict[str, Any]:
    """Interpolation error of the knots of one channel."""
    result: dict[str, Any] = {"T_C": table.temperature_c[1:-1]}
    for name, values in zip(COMPENSATED[sensor], (table.zero, table.scale), strict=True):
        check = check_model(table.temperature_c, values)
        largest = float(np.max(np.abs(check.curvature))) if len(check.curvature) else None
        result[name] = {"left_out_error": check.error, "max_curvature_per_C2": largest}
    return result


REDUCTIONS: Reductions = {
    ("M2", ""): Reduction(
        _imu, ("positions", "rates", "apply"), ("table",), frozenset({MISSING_POSITION, MISSING_RATE, INCONSISTENT})
    )
}
