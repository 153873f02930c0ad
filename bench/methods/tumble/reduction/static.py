"""Static temperature characteristic: tumbles at soaked temperatures (equations 6.2 and 6.6).

Each dwell gives one bias and one scale factor; over all dwells these give temperature models and the hysteresis between
rising and falling temperature.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from bench.methods.tumble.reduction.solution import (
    FOUR_POINTS_DEG,
    Hysteresis,
    Tumble,
    hysteresis,
    missing_positions_deg,
    solve_tumble,
    turn_between_deg,
)
from bench.metrology.least_squares import Array, PolynomialFit, choose_degree, fit_polynomial
from bench.metrology.temperature_checks import broken_at_rest

HIGHEST_DEGREE = 4


@dataclass(frozen=True, slots=True)
class TumbleRecord:
    """One row per reading in any order, all arrays (n,); a missing number is NaN, a missing leg is empty.

    `leg` is "up" or "down", `dwell` numbers the visits of set points, `position_deg` is the actual angle of the input
    axis above the horizontal.
    """

    cycle: Array
    leg: NDArray[np.str_]
    dwell: Array
    set_c: Array
    measured_c: Array
    position_deg: Array
    repetition: Array
    output_v: Array
    valid: NDArray[np.bool_]

    def rows(self, which: NDArray[np.int_] | NDArray[np.bool_]) -> TumbleRecord:
        """A part of the record, by row numbers or by a mask."""
        return TumbleRecord(**{column.name: getattr(self, column.name)[which] for column in fields(self)})


@dataclass(frozen=True, slots=True)
class Dwell:
    """Tumble at one visit of a set point, in V; `temperature_c` is the mean of the thermometer."""

    cycle: int
    leg: str
    number: int
    set_c: float
    temperature_c: float
    tumble: Tumble


@dataclass(frozen=True, slots=True)
class Characteristic:
    """One quantity over temperature; a part is None if there are too few temperatures for it."""

    polynomial: PolynomialFit | None
    line: PolynomialFit | None
    hysteresis: Hysteresis | None


@dataclass(frozen=True, slots=True)
class StaticCharacteristic:
    """Dwells by cycle and number; `bias` (c0) in V, `scale` (K1) in V/g; `excluded` counts rows by reason."""

    dwells: tuple[Dwell, ...]
    bias: Characteristic
    scale: Characteristic
    flags: tuple[str, ...]
    excluded: dict[str, int]


def reduce_static(record: TumbleRecord, degree: int | None = None) -> StaticCharacteristic:
    """Reduce a record to tumbles and their temperature models.

    A dwell is solved from all its good readings: at four positions least squares go through the mean of each. A dwell
    with a position without a good reading is left out and flagged. `degree` is that of the temperature models; a degree
    that the temperatures do not permit is reduced and flagged, None chooses it by the data among 1 to 4.
    """
    flags: list[str] = []
    excluded: Counter[str] = Counter()
    dwells = tuple(_dwells(record, flags, excluded))
    bias = _characteristic("K0", np.array([d.tumble.c0 for d in dwells]), dwells, degree, flags)
    scale = _characteristic("K1", np.array([d.tumble.k1 for d in dwells]), dwells, degree, flags)
    return StaticCharacteristic(dwells, bias, scale, tuple(flags), dict(excluded))


def _dwells(record: TumbleRecord, flags: list[str], excluded: Counter[str]) -> Iterator[Dwell]:
    """Complete dwells; missing data are added to `flags` and `excluded`."""
    keys = np.stack([record.cycle, record.dwell, record.leg == "down", record.set_c], axis=-1)
    placed = np.isfinite(keys).all(axis=-1) & np.isfinite(record.position_deg) & np.isin(record.leg, ("up", "down"))
    _count(excluded, "missing", ~placed)
    if not placed.any():
        return
    record = record.rows(placed)
    names = _names(record.position_deg)
    visits, visit = np.unique(keys[placed], axis=0, return_inverse=True)
    members = np.split(np.argsort(visit, kind="stable"), np.cumsum(np.bincount(visit))[:-1])
    for (cycle, number, falling, set_c), rows in zip(visits, members, strict=True):
        scheduled = record.rows(rows)
        good = _good(scheduled, excluded)
        missing = missing_positions_deg(good.position_deg)
        if missing:
            flags.extend(f"dwell {number:.0f} incomplete: {names[position_deg]}" for position_deg in missing)
        elif 2 * len(good.cycle) < len(_first_of_each(scheduled)):
            flags.append(f"dwell {number:.0f} invalid")
        else:
            yield Dwell(
                cycle=int(cycle),
                leg="down" if falling else "up",
                number=int(number),
                set_c=float(set_c),
                temperature_c=float(np.mean(good.measured_c)),
                tumble=solve_tumble(np.radians(good.position_deg), good.output_v),
            )


def _names(angle_deg: Array) -> dict[float, str]:
    """Name in this record of each of the four positions: 91 if always visited at 91°, else whole degrees."""
    names = {}
    for position_deg in FOUR_POINTS_DEG:
        away_deg = turn_between_deg(position_deg, angle_deg)
        near_deg = (position_deg + away_deg[np.abs(away_deg) < 45]) % 360
        always = len(near_deg) > 0 and np.ptp(near_deg) == 0
        names[position_deg] = f"{near_deg[0] if always else position_deg:g}"
    return names


def _good(dwell: TumbleRecord, excluded: Counter[str]) -> TumbleRecord:
    """Readings of one dwell that count: present, valid, with a working thermometer, each repetition once."""
    present = np.isfinite(dwell.measured_c) & np.isfinite(dwell.output_v)
    _count(excluded, "missing", ~present)
    _count(excluded, "invalid", present & ~dwell.valid)
    dwell = dwell.rows(present & dwell.valid)
    broken = broken_at_rest(dwell.measured_c)
    _count(excluded, "thermometer", broken)
    dwell = dwell.rows(~broken)
    first = _first_of_each(dwell)
    excluded["duplicate"] += len(dwell.cycle) - len(first)
    return dwell.rows(first)


def _first_of_each(dwell: TumbleRecord) -> NDArray[np.int_]:
    """Indices of the first row of each repetition of each position."""
    reading = np.stack([dwell.position_deg, np.nan_to_num(dwell.repetition, nan=-1)], axis=-1)
    return np.sort(np.unique(reading, axis=0, return_index=True)[1])


def _count(excluded: Counter[str], reason: str, rows: NDArray[np.bool_]) -> None:
    excluded[reason] += int(np.sum(rows))


def _characteristic(
    name: str, value: Array, dwells: tuple[Dwell, ...], degree: int | None, flags: list[str]
) -> Characteristic:
    """Models and hysteresis of one quantity (n,), one value per dwell."""
    temperature_c = np.array([dwell.temperature_c for dwell in dwells])
    set_c = np.array([dwell.set_c for dwell in dwells])
    allowed = len(np.unique(set_c)) - 1
    if allowed < (1 if degree is None else degree):
        flags.append(f"{name}:too_few_temperatures")
    if degree is None:
        degree = choose_degree(temperature_c, value, min(HIGHEST_DEGREE, max(allowed, 1)))
    if allowed < 0:
        return Characteristic(None, None, None)
    polynomial = fit_polynomial(temperature_c, value, min(degree, allowed))
    line = fit_polynomial(temperature_c, value, 1) if allowed >= 1 else None
    loop = hysteresis(
        value, temperature_c, set_c, slope=polynomial.slope,
        rising=np.array([dwell.leg == "up" for dwell in dwells]),
        cycle=np.array([dwell.cycle for dwell in dwells]),
    )  # fmt: skip
    return Characteristic(polynomial, line, loop)
