"""Record of a temperature ramp: bad samples removed, divided into legs of rising and falling temperature."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.ramp.reduction.turns import on_its_way, stretches
from bench.metrology.least_squares import Array
from bench.metrology.temperature_checks import broken_on_a_ramp


@dataclass(frozen=True, slots=True)
class RampRecord:
    """One row per sample in any order, all arrays (n,); a missing number is NaN, a missing leg is empty.

    `leg` is "up" or "down"; `time_s` increases within a leg of a cycle.
    """

    cycle: Array
    leg: NDArray[np.str_]
    time_s: Array
    temperature_c: Array
    output_g: Array


@dataclass(frozen=True, slots=True)
class Leg:
    """Usable samples of one leg of one cycle in time order, arrays (n,).

    `complete` is false if fewer than half of the recorded samples could be used, or if all of them go in the other
    direction: then it is `against` its name, and empty.
    """

    cycle: int
    name: str
    time_s: Array
    temperature_c: Array
    output_g: Array
    complete: bool
    against: bool

    def stretches(self, longest_hole: int) -> Iterator[slice]:
        """Parts of the leg without a gap in time longer than `longest_hole` sample intervals."""
        return stretches(self.time_s, longest_hole)


def cut_into_legs(record: RampRecord, *, turns: bool = False) -> tuple[list[Leg], dict[str, int]]:
    """Legs by cycle, up before down, and the number of rows left out for each reason.

    Left out are rows with missing values, implausible temperatures, all but the first good row of one time, and those
    of the turn-rounds at the ends of a leg ("turn"), unless `turns` are wanted.
    """
    keys = np.stack([record.cycle, record.leg == "down", record.time_s], axis=-1)
    placed = np.isfinite(keys).all(axis=-1) & np.isin(record.leg, ("up", "down"))
    good = placed & np.isfinite(record.temperature_c) & np.isfinite(record.output_g)
    order = _one_row_of_each_time(keys, placed, good)
    excluded = Counter(
        missing=int(np.sum(~good)), duplicate=int(np.sum(good) - np.sum(good[order])), thermometer=0, turn=0
    )
    legs = []
    starts = np.flatnonzero(np.any(np.diff(keys[order, :2], axis=0) != 0, axis=-1)) + 1
    for scheduled in np.split(order, starts) if len(order) else []:
        rows = scheduled[good[scheduled]]
        broken = broken_on_a_ramp(record.time_s[rows], record.temperature_c[rows])
        excluded["thermometer"] += int(np.sum(broken))
        rows = rows[~broken]
        cycle, falling = keys[scheduled[0], :2]
        way = rows[on_its_way(record.time_s[rows], record.temperature_c[rows], falls=bool(falling))]
        way = rows if turns else way
        excluded["turn"] += len(rows) - len(way)
        legs.append(
            Leg(
                cycle=int(cycle),
                name="down" if falling else "up",
                time_s=record.time_s[way],
                temperature_c=record.temperature_c[way],
                output_g=record.output_g[way],
                complete=2 * len(rows) >= len(scheduled) and len(way) > 0,
                against=len(rows) > 0 and not len(way) and _falls(record.temperature_c[rows]) != bool(falling),
            )
        )
    return legs, dict(excluded)


def _falls(temperature_c: Array) -> bool:
    return bool(temperature_c[-1] < temperature_c[0])


def _one_row_of_each_time(keys: Array, placed: NDArray[np.bool_], good: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Indices of the placed rows by cycle, leg and time (`keys`); of equal ones the first good row if there is one."""
    order = np.lexsort((~good, keys[:, 2], keys[:, 1], keys[:, 0]))
    order = order[placed[order]]
    repeated = np.all(np.diff(keys[order], axis=0) == 0, axis=-1)
    return np.delete(order, np.flatnonzero(repeated) + 1)
