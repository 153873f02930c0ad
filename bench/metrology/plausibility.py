"""Numbers that no instrument of a bench gives: other units, exchanged columns (equations 1.1, 1.10).

The bounds are those of physics and of the apparatus, wide enough for every sensor of the methods; what is beyond them
is doubted, not corrected.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array
from bench.metrology.temperature_checks import POSSIBLE_C

LARGEST_OUTPUT_V = 100.0
SCALES_V_PER_G = (1e-4, 1e3)
LARGEST_REST_G = 1.5  # of what gravity and a bias make together
LARGEST_SLOPE_G_PER_C = 2e-3
RAMPS_C_PER_MIN = (0.005, 200.0)
MOST = 0.9  # the share of readings that must be beyond a bound less this is at least a tenth
GRID_DEG = 0.25  # whose multiples an indexing table is sent to
MOST_TURNED_DEG = 361.0
KELVIN = 273.15
LEAST_FROZEN = 3  # readings
LEAST_STILL = 20  # samples
MOST_STILL = 0.25  # of them
_NEAR = 0.05  # of a factor between two units
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
    """Reason not to rely on a result: a flag and a note of what was seen. Without a flag it is a remark."""

    flag: str
    note: str


def slip(ratio: float) -> str:
    """What a ratio of found to expected looks like, as the tail of a sentence; empty where it looks like nothing."""
    size = abs(ratio)
    for factor, words in _FACTORS:
        for each in (factor, 1 / factor):
            if abs(size / each - 1) < _NEAR:
                return f", {words}" if each >= 1 else f", {words}, the other way round"
    return ""


def beyond(values: Array, largest: float) -> float | None:
    """The 90th percentile of the magnitude of values (n,), where it is beyond `largest`; NaN is not counted."""
    known = np.abs(values[np.isfinite(values)])
    size = float(np.quantile(known, MOST)) if len(known) else 0.0
    return size if size > largest else None


def outputs(column: str, values_v: Array) -> Iterator[Doubt]:
    """Readings that are no voltages of a sensor."""
    size = beyond(values_v, LARGEST_OUTPUT_V)
    if size is not None:
        yield Doubt("implausible_output", f"{column}: readings go to {size:.4g} V; are they in mV or µV?")


def frozen(column: str, values: Array) -> Doubt | None:
    """Doubt about readings (n,) that are one and the same number; None where they are not, or are too few to tell."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_FROZEN or np.ptp(known):
        return None
    return Doubt("implausible_output", f"{column}: all {len(known)} readings are {known[0]:.6g}: the output is frozen")


def stands_still(values: Array) -> bool:
    """Whether values (n,) in the order of time stay one and the same number for a good part of the time."""
    changes = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    return len(values) >= LEAST_STILL and int(np.max(np.diff(changes))) > MOST_STILL * len(values)


def scale(name: str, value: float | None, bounds: tuple[float, float], unit: str) -> Iterator[Doubt]:
    """A scale factor beyond its bounds."""
    if value is not None and np.isfinite(value) and not bounds[0] <= abs(value) <= bounds[1]:
        yield Doubt(
            "implausible_scale",
            f"{name} is {value:.6g} {unit}, beyond {bounds[0]:g} to {bounds[1]:g} {unit}: see the units of the columns "
            "and whether two are exchanged",
        )


def on_grid(angles_deg: Array) -> bool:
    """Whether angles (n,) in degrees are such as a table is sent to: more than one, and all multiples of 0.25°."""
    known = angles_deg[np.isfinite(angles_deg)]
    if len(known) < 2 or not np.ptp(known):
        return False
    return bool(np.all(np.abs(known / GRID_DEG - np.round(known / GRID_DEG)) < 1e-3))


def angles(column: str, angles_deg: Array) -> Iterator[Doubt]:
    """Angles of a head that are more than a turn, or whole degrees only if they are radians."""
    far_deg = beyond(angles_deg, MOST_TURNED_DEG)
    if far_deg is not None:
        yield Doubt("implausible_angle", f"{column}: angles go to {far_deg:.4g}°; are they minutes or seconds of arc?")
    yield from radians(column, angles_deg)


def radians(column: str, angles_deg: Array) -> Iterator[Doubt]:
    """Angles, or rates, within two turns that are whole degrees only if they are radians."""
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
    """Temperatures most of which are outside the range of any chamber, in °C."""
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
    """A ramp at a rate that no chamber has; readings of one leg in the order of time (n,)."""
    if len(time_s) < 3 or not np.ptp(time_s):
        return
    away_s = time_s - np.mean(time_s)
    c_per_min = 60 * abs(float(away_s @ temperature_c / (away_s @ away_s)))
    if np.ptp(temperature_c) > 1 and not RAMPS_C_PER_MIN[0] <= c_per_min <= RAMPS_C_PER_MIN[1]:
        unit = "milliseconds" if c_per_min < RAMPS_C_PER_MIN[0] else "minutes or hours"
        yield Doubt("implausible_time", f"t_s: the temperature went at {c_per_min:.3g} °C/min; is the time in {unit}?")
