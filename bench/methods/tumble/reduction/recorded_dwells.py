"""From the readings of a recorded case to its dwells: which of them count (equations 6.2 and 6.6)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.tumble.reduction.dwells import DWELL_ILL_CONDITIONED, DWELL_INCOMPLETE, SolvedDwell
from bench.methods.tumble.reduction.solution import (
    FOUR_POINTS_DEG,
    IncompleteTumble,
    missing_positions_deg,
    solve_tumble,
    turn_between_deg,
)
from bench.metrology.least_squares import Array
from bench.metrology.results.flag import Flag
from bench.metrology.rows import Rows
from bench.metrology.temperature_checks import broken_at_rest

DWELL_INVALID = "dwell {number} invalid"


@dataclass(frozen=True, slots=True)
class TumbleRecord(Rows):
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


def recorded_dwells(record: TumbleRecord) -> tuple[tuple[SolvedDwell, ...], list[Flag], dict[str, int]]:
    """The tumbles by cycle and number; flags of dwells that are left out, and how many rows were, by reason.

    A dwell is solved for the four constants that the format has, from all its good readings: at four positions least
    squares go through the mean of each. A dwell with a position that has no good reading is left out.
    """
    flags: list[Flag] = []
    excluded: Counter[str] = Counter()
    dwells = tuple(_dwells(record, flags, excluded))
    return dwells, flags, dict(excluded)


def _dwells(record: TumbleRecord, flags: list[Flag], excluded: Counter[str]) -> Iterator[SolvedDwell]:
    """The dwells that are complete; what is missing goes to `flags` and `excluded`."""
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
            flags.extend(
                Flag(DWELL_INCOMPLETE, values={"number": f"{number:.0f}", "angles": names[each]}) for each in missing
            )
        elif 2 * len(good.cycle) < len(_first_of_each(scheduled)):
            flags.append(Flag(DWELL_INVALID, values={"number": f"{number:.0f}"}))
        else:
            try:
                tumble = solve_tumble(np.radians(good.position_deg), good.output_v)
            except IncompleteTumble:
                values = {"number": f"{number:.0f}"}
                flags.append(Flag(DWELL_ILL_CONDITIONED, values=values))
                continue
            temperature_c = float(np.mean(good.measured_c))
            yield SolvedDwell(int(number), int(cycle), not falling, float(set_c), temperature_c, tumble)


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
