"""The record of a temperature ramp: bad samples left out, cut into legs of rising and of falling temperature."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.analysis.fit import Array
from bench.analysis.thermometer import broken_on_a_ramp


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
    """The usable samples of one leg of one cycle in the order of time, arrays (n,).

    `complete` is false when fewer than half of the recorded samples could be used.
    """

    cycle: int
    name: str
    time_s: Array
    temperature_c: Array
    output_g: Array
    complete: bool

    def stretches(self, longest_hole: int) -> Iterator[slice]:
        """Parts of the leg without a hole in time longer than `longest_hole` sample intervals."""
        interval_s = np.diff(self.time_s)
        limit_s = longest_hole * float(np.median(interval_s)) if len(interval_s) else 0.0
        holes = np.flatnonzero(interval_s > limit_s) + 1
        return (slice(start, end) for start, end in pairwise([0, *holes.tolist(), len(self.time_s)]))


def cut_into_legs(record: RampRecord) -> tuple[list[Leg], dict[str, int]]:
    """The legs by cycle, up before down, and how many rows were left out for which reason.

    Left out are rows with something missing, temperatures that a working thermometer cannot say, and all but the first
    good row of one time.
    """
    keys = np.stack([record.cycle, record.leg == "down", record.time_s], axis=-1)
    placed = np.isfinite(keys).all(axis=-1) & np.isin(record.leg, ("up", "down"))
    good = placed & np.isfinite(record.temperature_c) & np.isfinite(record.output_g)
    order = _one_row_of_each_time(keys, placed, good)
    excluded = Counter(missing=int(np.sum(~good)), duplicate=int(np.sum(good) - np.sum(good[order])), thermometer=0)
    legs = []
    starts = np.flatnonzero(np.any(np.diff(keys[order, :2], axis=0) != 0, axis=-1)) + 1
    for scheduled in np.split(order, starts) if len(order) else []:
        rows = scheduled[good[scheduled]]
        broken = broken_on_a_ramp(record.time_s[rows], record.temperature_c[rows])
        excluded["thermometer"] += int(np.sum(broken))
        rows = rows[~broken]
        cycle, falling = keys[scheduled[0], :2]
        legs.append(
            Leg(
                cycle=int(cycle),
                name="down" if falling else "up",
                time_s=record.time_s[rows],
                temperature_c=record.temperature_c[rows],
                output_g=record.output_g[rows],
                complete=2 * len(rows) >= len(scheduled),
            )
        )
    return legs, dict(excluded)


def _one_row_of_each_time(keys: Array, placed: NDArray[np.bool_], good: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Numbers of the placed rows by cycle, leg and time (`keys`); of equal ones the first good row if there is one."""
    order = np.lexsort((~good, keys[:, 2], keys[:, 1], keys[:, 0]))
    order = order[placed[order]]
    repeated = np.all(np.diff(keys[order], axis=0) == 0, axis=-1)
    return np.delete(order, np.flatnonzero(repeated) + 1)
