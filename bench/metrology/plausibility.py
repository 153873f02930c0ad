"""Implausible data: values in other units, exchanged columns (equations 1.1, 1.10).

The bounds are those of physics and of the apparatus, wide enough for every sensor of the methods; values beyond them
are reported as doubtful, not corrected.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array
from bench.metrology.temperature_checks import POSSIBLE_C

LARGEST_OUTPUT_V = 100.0
SCALES_V_PER_G = (1e-4, 1e3)
LARGEST_REST_G = 1.5  # upper bound of gravity plus bias
LARGEST_SLOPE_G_PER_C = 2e-3
RAMPS_C_PER_MIN = (0.005, 200.0)
MOST = 0.9  # quantile that must be beyond a bound: at least a tenth of the readings
GRID_DEG = 0.25  # grid of the angles of an indexing table
MOST_TURNED_DEG = 361.0
KELVIN = 273.15
LEAST_FROZEN = 3  # readings
LEAST_STILL = 20  # samples
MOST_STILL = 0.25  # of the samples
_NEAR = 0.05  # relative deviation from a factor between two units
_FACTORS = (
    (180 / np.pi, "as degrees for radians"),
    (9.80665, "as m/s² for g"),
    (2 * np.pi, "as of a circular frequency"),
    (360.0, "as degrees for turns"),
    (60.0, "as between seconds and minutes"),
    (1e3, "as a thousandth for the unit"),
    (3600.0, "as between seconds and hours"),
    (1e6, "as a millionth for the unit"),
)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason not to rely on a result: a flag and a note with the evidence. Without a flag it is a remark."""

    flag: str
    note: str


def slip(ratio: float) -> str:
    """Known factor that a ratio of found to expected resembles, as the tail of a sentence; "" if none."""
    size = abs(ratio)
    for factor, words in _FACTORS:
        for each in (factor, 1 / factor):
            if abs(size / each - 1) < _NEAR:
                return f", {words}" if each >= 1 else f", {words}, the other way round"
    return ""


def beyond(values: Array, largest: float) -> float | None:
    """90th percentile of the magnitude of values (n,) if it is above `largest`; NaN is not counted."""
    known = np.abs(values[np.isfinite(values)])
    size = float(np.quantile(known, MOST)) if len(known) else 0.0
    return size if size > largest else None


def outputs(column: str, values_v: Array) -> Iterator[Doubt]:
    """Doubt about readings that cannot be voltages of a sensor."""
    size = beyond(values_v, LARGEST_OUTPUT_V)
    if size is not None:
        yield Doubt("implausible_output", f"{column}: readings go to {size:.4g} V; are they in mV or µV?")


def frozen(column: str, values: Array) -> Doubt | None:
    """Doubt about readings (n,) that are all equal; None if they differ or are too few."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_FROZEN or np.ptp(known):
        return None
    return Doubt("implausible_output", f"{column}: all {len(known)} readings are {known[0]:.6g}: the output is frozen")


def stands_still(values: Array) -> bool:
    """True if values (n,) in time order stay constant for a considerable part of the time."""
    changes = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    return len(values) >= LEAST_STILL and int(np.max(np.diff(changes))) > MOST_STILL * len(values)


def scale(name: str, value: float | None, bounds: tuple[float, float], unit: str) -> Iterator[Doubt]:
    """Doubt about a scale factor outside its bounds."""
    if value is not None and np.isfinite(value) and not bounds[0] <= abs(value) <= bounds[1]:
        yield Doubt(
            "implausible_scale",
            f"{name} is {value:.6g} {unit}, beyond {bounds[0]:g} to {bounds[1]:g} {unit}: see the units of the columns "
            "and whether two are exchanged",
        )


def on_grid(angles_deg: Array) -> bool:
    """True if angles (n,) in degrees look like set angles: more than one, and all multiples of 0.25°."""
    known = angles_deg[np.isfinite(angles_deg)]
    if len(known) < 2 or not np.ptp(known):
        return False
    return bool(np.all(np.abs(known / GRID_DEG - np.round(known / GRID_DEG)) < 1e-3))


def angles(column: str, angles_deg: Array) -> Iterator[Doubt]:
    """Doubt about angles of a head that exceed a turn, or are whole degrees only if they are radians."""
    far_deg = beyond(angles_deg, MOST_TURNED_DEG)
    if far_deg is not None:
        yield Doubt("implausible_angle", f"{column}: angles go to {far_deg:.4g}°; are they minutes or seconds of arc?")
    yield from radians(column, angles_deg)


def radians(column: str, angles_deg: Array) -> Iterator[Doubt]:
    """Doubt about angles, or rates, within two turns that are whole degrees only if they are radians."""
    known = angles_deg[np.isfinite(angles_deg)]
    if not len(known) or np.max(np.abs(known)) > 4 * np.pi or on_grid(known):
        return
    if on_grid(np.degrees(known)):
        largest = float(np.max(np.abs(known)))
        yield Doubt(
            "implausible_angle",
            f"{column}: angles up to {largest:.4g}, taken for degrees, would be whole degrees if they were radians",
        )


def kelvin(column: str, temperature_c: Array) -> Iterator[Doubt]:
    """Doubt about temperatures in °C if most of them are outside the range of any chamber."""
    known = temperature_c[np.isfinite(temperature_c)]
    if not len(known) or np.mean((known < POSSIBLE_C[0]) | (known > POSSIBLE_C[1])) <= 0.5:
        return
    middle = float(np.median(known))
    is_kelvin = POSSIBLE_C[0] < middle - KELVIN < POSSIBLE_C[1]
    yield Doubt(
        "implausible_temperature",
        f"{column}: most readings are beyond what a chamber has, {middle:.4g} °C in the middle"
        + ("; are they in kelvin?" if is_kelvin else ""),
    )


def ramp(time_s: Array, temperature_c: Array) -> Iterator[Doubt]:
    """Doubt about a ramp at a rate that no chamber reaches; readings of one leg in time order (n,)."""
    if len(time_s) < 3 or not np.ptp(time_s):
        return
    away_s = time_s - np.mean(time_s)
    c_per_min = 60 * abs(float(away_s @ temperature_c / (away_s @ away_s)))
    if np.ptp(temperature_c) > 1 and not RAMPS_C_PER_MIN[0] <= c_per_min <= RAMPS_C_PER_MIN[1]:
        unit = "milliseconds" if c_per_min < RAMPS_C_PER_MIN[0] else "minutes or hours"
        yield Doubt("implausible_time", f"t_s: the temperature went at {c_per_min:.3g} °C/min; is the time in {unit}?")
