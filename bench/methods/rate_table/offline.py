"""Cases of method M3: range and frequency response on a single-axis table (equations 5 and 9)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bench.errors import InputError
from bench.methods.rate_table.reduction import plausibility as plausibility_table
from bench.methods.rate_table.reduction.blocks import TableRecord
from bench.methods.rate_table.reduction.lever_arm import AccelerometerSweep, accelerometer_response
from bench.methods.rate_table.reduction.recorded_range import (
    BIAS,
    BLOCK_INVALID,
    RADIUS_NOT_DETERMINED,
    TOO_FEW_LOW_RATES,
    LinearityLimit,
    RangePoint,
    RangeTest,
    accelerometer_range,
    gyro_range,
)
from bench.methods.rate_table.reduction.response_points import (
    FrequencyResponse,
    ResponsePoint,
    at_frequency,
    gyro_response,
)
from bench.methods.rate_table.reduction.two_sample import velocity_increments
from bench.methods.rate_table.words import UNITS
from bench.metrology.least_squares import Array
from bench.metrology.normal_gravity import normal_gravity_mps2
from bench.metrology.plausibility import Doubt
from bench.metrology.results.flag import INVALID
from bench.offline.case_file import Case, Limit, LocalGravity, Reduction, Reductions, Settings
from bench.offline.csv_record import Table
from bench.offline.doubts import SIGNS_OR_ROWS
from drivers.schema.wording import telling

Positive = Annotated[float, Field(gt=0)]
LARGEST_U_GAIN = 0.2  # relative standard uncertainty of the gain
LONGEST_TOTAL_S = 1.0  # of two samples
AS_NOTES = ("rest_missing", "lever_arm_short")  # flags that are not published for cases
Basis = Literal["reading", "full_scale"]


def _named_runs(commands_dps: dict[str, float]) -> dict[str, float]:
    for name, rate_dps in commands_dps.items():
        if not re.fullmatch(r"run[0-9]{1,6}", name):
            raise telling(f"'{name}' is not run1, run2, ...")
        if rate_dps == 0:
            raise telling(f"'{name}' is 0; the rate at rest belongs to the bias")
    return commands_dps


class GyroRangeSettings(Settings):
    """Settings of `gyro_range`; the full scale is needed if errors are fractions of it."""

    commands_dps: Annotated[dict[str, float], AfterValidator(_named_runs)] = Field(min_length=1)
    fraction: Limit = Field(alias="k_m")
    basis: Basis = Field("reading", alias="linearity_basis")
    full_scale_dps: Positive | None = None
    clip_dps: Positive | None = None
    rate_tolerance: Limit = Field(0.01, alias="rate_tol")


class AccelerometerRangeSettings(Settings):
    """Settings of `acc_range`."""

    local_g_mps2: LocalGravity | None = Field(None, alias="g_mps2")
    range_g: Positive
    fraction: Limit = Field(alias="k_m")
    basis: Basis = Field("full_scale", alias="linearity_basis")
    clip_g: Positive | None = None


class GyroSweepSettings(Settings):
    """Settings of `gyro_freq`."""

    settle_s: Limit = 0.0
    gain_reference: Literal["absolute", "lowest"] = "absolute"


class AccelerometerSweepSettings(Settings):
    """Settings of `acc_freq`."""

    local_g_mps2: LocalGravity | None = Field(None, alias="g_mps2")
    interval_s: Positive = Field(alias="Ts_s")
    lever_hz: Positive = Field(0.5, alias="lever_f_Hz")
    settle_s: Limit = 0.0


class TwoSampleSettings(Settings):
    """Settings of `two_sample`."""

    total_s: Positive = Field(alias="h_s")
    x_m: float = Field(alias="rx_m")
    y_m: float = Field(alias="ry_m")


def _gyro_range(case: Case) -> dict[str, Any]:
    settings = case.settings(GyroRangeSettings)
    by_full_scale = settings.basis == "full_scale"
    if by_full_scale and settings.full_scale_dps is None:
        raise InputError(f"{case.name}: settings.full_scale_dps: is missing; the linearity_basis 'full_scale' needs it")
    table = case.record("range", "phase,t_s,enc_deg,out_dps")
    record = _range_record(table, "out_dps", ("run",))
    unknown = sorted(set(np.unique(record.block).tolist()) - {"", BIAS, *settings.commands_dps})
    if unknown:
        raise InputError(f"{case.name}: settings.commands_dps: {unknown[0]} is missing; {table.file} has that phase")
    found = gyro_range(
        record, settings.commands_dps,
        LinearityLimit(settings.fraction, settings.full_scale_dps if by_full_scale else None),
        clip_dps=settings.clip_dps, rate_tolerance=settings.rate_tolerance,
    )  # fmt: skip
    doubts = [
        *plausibility_table.clock(record),
        *plausibility_table.gyro_range(record, settings.commands_dps, settings.clip_dps),
        *plausibility_table.of_range(
            max(map(abs, settings.commands_dps.values())), settings.full_scale_dps, "full_scale_dps"
        ),
    ]
    return {"bias_dps": found.bias, **_range_result(found, _gyro_point), "doubts": doubts}


def _acc_range(case: Case) -> dict[str, Any]:
    settings = case.settings(AccelerometerRangeSettings)
    local_g_mps2, gravity_notes = _local_g_mps2(case, settings.local_g_mps2)
    record = _range_record(case.record("range", "phase,t_s,enc_deg,acc_g"), "acc_g", ("low", "run"))
    found = accelerometer_range(
        record,
        local_g_mps2,
        LinearityLimit(settings.fraction, settings.range_g if settings.basis == "full_scale" else None),
        clip_g=settings.clip_g,
    )
    return {
        "bias_g": found.bias,
        "radius_m": found.radius_m,
        "u_radius_m": found.u_radius_m,
        **_range_result(found, lambda point: _accelerometer_point(point, found.bias), gravity_notes),
        "doubts": [
            *plausibility_table.clock(record),
            *plausibility_table.accelerometer_range(record, found.radius_m, found.bias, settings.clip_g),
            *plausibility_table.of_range(
                max((abs(point.error.true) for point in found.points if point.error), default=0.0),
                settings.range_g,
                "range_g",
            ),
        ],
    }


def _local_g_mps2(case: Case, given_mps2: float | None) -> tuple[float, tuple[str, ...]]:
    """Gravity by the settings, or normal gravity at the site with a note on it."""
    if given_mps2 is not None:
        return given_mps2, ()
    site = case.site
    if site.latitude_deg is None or site.height_m is None:
        raise InputError(f"{case.name}: settings.g_mps2: is missing; give it, or the site's lat_deg and h_m")
    normal_mps2 = normal_gravity_mps2(site.latitude_deg, site.height_m)
    return normal_mps2, (f"g_mps2 is not given; normal gravity at the site is taken, {normal_mps2:.6f} m/s²",)


def _range_record(table: Table, output: str, kinds: Iterable[str]) -> TableRecord:
    """Record of a range; its phases are bias, and words of the `kinds` with a number."""
    seen = {text.strip().lower() for text in set(table.columns["phase"])}
    numbered = sorted(word for word in seen if re.fullmatch(rf"({'|'.join(kinds)})[0-9]{{1,6}}", word))
    return TableRecord(
        block=table.words("phase", (BIAS, *(numbered or [f"{kind}1" for kind in kinds]))),
        time_s=table.numbers("t_s"),
        table=table.numbers("enc_deg"),
        output=table.numbers(output),
    )


def _range_result(
    found: RangeTest, point: Callable[[RangePoint], dict[str, Any]], notes: Iterable[str] = ()
) -> dict[str, Any]:
    return {
        "points": [point(each) for each in found.points],
        "passed": found.passed,
        **_remarks(found, notes),
    }


def _gyro_point(point: RangePoint) -> dict[str, Any]:
    return {
        "phase": point.turning.step,
        "mean_dps": point.turning.steady.output,
        "table_dps": point.turning.steady.rate_dps,
        "error_dps": point.error.value if point.error else None,
        "rel_error": point.relative_error,
        "passed": point.passed,
        "marginal": point.marginal,
        "saturated": point.turning.steady.saturated,
        "stable": point.stable,
    }


def _accelerometer_point(point: RangePoint, bias_g: float | None) -> dict[str, Any]:
    return {
        "phase": point.turning.step,
        "a_meas_g": None if bias_g is None else point.turning.steady.output - bias_g,
        "a_true_g": point.error.true if point.error else None,
        "rate_dps": point.turning.steady.rate_dps,
        "rel_error": point.relative_error,
        "passed": point.passed,
        "marginal": point.marginal,
        "saturated": point.turning.steady.saturated,
    }


def _gyro_freq(case: Case) -> dict[str, Any]:
    settings = case.settings(GyroSweepSettings)
    record = _sweep_record(case.record("sweep", "f_Hz,t_s,enc_deg,gyro_dps"), "enc_deg", "gyro_dps")
    found = gyro_response(record, settle_s=settings.settle_s, to_lowest=settings.gain_reference == "lowest")
    doubts = [
        *plausibility_table.clock(record), *plausibility_table.gyro_sweep(record), *_no_swing(found.points),
    ]  # fmt: skip
    return {**_response(found), "doubts": doubts}


def _no_swing(points: Sequence[ResponsePoint]) -> Iterator[Doubt]:
    """Note on a gain that is uncertain even at the lowest frequency, where a gyro follows its table."""
    lowest = min(points, key=lambda point: point.frequency_hz, default=None)
    if lowest is not None and lowest.u_gain > LARGEST_U_GAIN * lowest.gain:
        seen = f"the gain at {lowest.frequency_hz:g} Hz is {lowest.gain:.3g} with u = {lowest.u_gain:.3g}"
        yield Doubt("implausible_scale", f"{seen}{SIGNS_OR_ROWS}")


def _acc_freq(case: Case) -> dict[str, Any]:
    settings = case.settings(AccelerometerSweepSettings)
    local_g_mps2, gravity_notes = _local_g_mps2(case, settings.local_g_mps2)
    record = _sweep_record(case.record("sweep", "f_Hz,t_s,dtheta_rad,acc_g"), "dtheta_rad", "acc_g")
    arm, found = accelerometer_response(
        record, AccelerometerSweep(local_g_mps2, settings.interval_s, settings.lever_hz, settings.settle_s)
    )
    lever = {
        "rxx_m": arm and arm.x_m,
        "rxy_m": arm and arm.y_m,
        "u_rxx_m": arm and arm.u_x_m,
        "u_rxy_m": arm and arm.u_y_m,
    }
    arms_m = (arm.x_m, arm.y_m) if arm else None
    doubts = [
        *plausibility_table.clock(record),
        *plausibility_table.accelerometer_sweep(record, settings.interval_s, arms_m),
    ]
    return {"lever": lever, **_response(found, gravity_notes), "doubts": doubts}


def _sweep_record(table: Table, angle: str, output: str) -> TableRecord:
    return TableRecord(table.numbers("f_Hz"), table.numbers("t_s"), table.numbers(angle), table.numbers(output))


def _response(found: FrequencyResponse, notes: Iterable[str] = ()) -> dict[str, Any]:
    return {
        "points": [_response_point(point) for point in found.points],
        "bandwidth_Hz": found.bandwidth.frequency_hz,
        "bandwidth_status": found.bandwidth.status,
        "bandwidth_crossings": found.bandwidth.crossings,
        "phase_at_bandwidth_deg": found.bandwidth.phase_deg,
        **_remarks(found, notes),
    }


def _remarks(found: RangeTest | FrequencyResponse, notes: Iterable[str]) -> dict[str, Any]:
    """Published flags, and all others as notes."""
    in_words = [flag.code for flag in found.flags if flag.code in AS_NOTES]
    return {
        "flags": [flag for flag in found.flags if flag.code not in in_words],
        "notes": [*notes, *found.notes, *(UNITS[code] for code in in_words)],
        "rejected": found.excluded,
    }


def _response_point(point: ResponsePoint) -> dict[str, Any]:
    return {
        "f_Hz": point.frequency_hz,
        "table_amp_dps": point.table_amplitude_dps,
        "gain": point.gain,
        "gain_dB": point.gain_db,
        "phase_deg": point.phase_deg,
        "u_gain": point.u_gain,
    }


def _two_sample(case: Case) -> dict[str, Any]:
    settings = case.settings(TwoSampleSettings)
    table = case.record("increments", "dtheta1_rad,dtheta2_rad")
    _, copies = table.without_copies()
    first_rad, second_rad = _usable(table.numbers("dtheta1_rad")), _usable(table.numbers("dtheta2_rad"))
    by_x_mps, by_y_mps = velocity_increments(
        first_rad, second_rad, total_s=settings.total_s, x_m=settings.x_m, y_m=settings.y_m
    )
    return {
        "dvx_mps": by_x_mps,
        "dvy_mps": by_y_mps,
        "flags": (),
        "notes": [f"rows that are equal to an earlier one, and reduced as all others: {copies}"] if copies else [],
        "rejected": {"missing": int(np.sum(~np.isfinite(first_rad + second_rad)))},
        "doubts": _no_increments(first_rad, second_rad, settings, table),
    }


def _no_increments(first_rad: Array, second_rad: Array, settings: TwoSampleSettings, table: Table) -> Iterator[Doubt]:
    """Notes on implausible increments, over half a turn, and on implausible times and positions."""
    size_rad = np.nan_to_num(np.maximum(np.abs(first_rad), np.abs(second_rad)))
    far = np.flatnonzero(size_rad > np.pi)
    if len(far):
        reach = f"increments reach {np.max(size_rad):.4g} rad, over half a turn, on {table.lines(far)}"
        yield Doubt("implausible_angle", f"{reach}; are they degrees?")
    total_s, away_m = settings.total_s, max(abs(settings.x_m), abs(settings.y_m))
    if total_s > LONGEST_TOTAL_S:
        yield Doubt("implausible_time", f"h_s is {total_s:g} s; is it in milliseconds?")
    rate_dps = float(np.degrees(np.median(size_rad))) / (total_s / 2) if len(size_rad) else 0.0
    if rate_dps > plausibility_table.FASTEST_DPS and not len(far):
        yield Doubt("implausible_time", f"by h_s the table turned at {rate_dps:.4g} °/s: see its unit")
    if away_m > plausibility_table.LARGEST_ARM_M:
        yield Doubt("implausible_scale", f"an arm is {away_m:g} m: are rx_m and ry_m in millimetres?")


def _usable(increment_rad: Array) -> Array:
    """Increments of plausible size; NaN for the rest."""
    return np.where(np.abs(increment_rad) < 1e100, increment_rad, np.nan)


# What makes a case incomplete.
OF_RANGE = frozenset({INVALID, BLOCK_INVALID, TOO_FEW_LOW_RATES, RADIUS_NOT_DETERMINED})
OF_SWEEP = frozenset({INVALID, at_frequency(INVALID, 0.0).code})

REDUCTIONS: Reductions = {
    ("M3", "gyro_range"): Reduction(_gyro_range, ("range",), ("points",), OF_RANGE),
    ("M3", "gyro_freq"): Reduction(_gyro_freq, ("sweep",), ("points",), OF_SWEEP),
    ("M3", "acc_range"): Reduction(_acc_range, ("range",), ("points",), OF_RANGE),
    ("M3", "acc_freq"): Reduction(_acc_freq, ("sweep",), ("points",), OF_SWEEP),
    ("M3", "two_sample"): Reduction(_two_sample, ("increments",), ("dvx_mps",)),
}
