"""Records of a rate table, divided into blocks of one motion of the table (equations 1.10)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.sampling import Kept, instantaneous
from bench.metrology.least_squares import Array

LARGEST_READING = 1e100  # larger values come from no instrument, and their square overflows
LEAST_SAMPLES = 3
LARGEST_GAP = 0.6  # of the time from the first sample to the last; three remaining samples may be slightly uneven
COMMON = 0.02  # share of all samples; a value this frequent indicates a coarse resolution


@dataclass(frozen=True, slots=True)
class TableRecord:
    """One row per sample in any order, all arrays (n,); a missing number is NaN, a missing word is empty.

    `block` names the motion of the table: a word or a frequency. `table` is the reading of its encoder, `output` that
    of the sensor.
    """

    block: NDArray[np.str_] | Array
    time_s: Array
    table: Array
    output: Array


@dataclass(frozen=True, slots=True)
class Block:
    """Usable samples of one block by increasing time; `scheduled` is the expected number.

    `step` is the resolution of a counted output, 0 for any other; `behind` is the lag from converter hysteresis that
    was removed from it. `rounding` is the resolution of samples that were not counted, and `kept` the response of the
    sampling to a sine. `table_step` is the resolution of the encoder, 0 if it is not known.
    """

    time_s: Array
    table: Array
    output: Array
    scheduled: int
    step: float = 0.0
    behind: Array | None = None
    rounding: float = 0.0
    kept: Kept = instantaneous
    table_step: float = 0.0

    @property
    def complete(self) -> bool:
        """True if at least half of the samples are left, and three, and they are one stretch of time.

        Two visits, or an outlying time stamp, leave a gap of more than half of the whole time.
        """
        if len(self.time_s) < max(LEAST_SAMPLES, self.scheduled / 2):
            return False
        return bool(np.max(np.diff(self.time_s)) <= LARGEST_GAP * np.ptp(self.time_s))


def cut_into_blocks(record: TableRecord, excluded: Counter[str], *, settle_s: float = 0.0) -> dict[Any, Block]:
    """Blocks by name, in the order of names; unusable samples are counted in `excluded` by reason.

    The first `settle_s` of each block are discarded. Of samples with one time stamp the first is kept.
    """
    named = record.block != "" if record.block.dtype.kind == "U" else np.isfinite(record.block)
    excluded["missing"] += int(np.sum(~named))
    excluded["duplicate"] += 0
    names, which = np.unique(record.block[named], return_inverse=True)
    members = np.split(np.flatnonzero(named)[np.argsort(which, kind="stable")], np.cumsum(np.bincount(which))[:-1])
    return {name: _block(record, rows, settle_s, excluded) for name, rows in zip(names.tolist(), members, strict=False)}


def _block(record: TableRecord, rows: NDArray[np.int_], settle_s: float, excluded: Counter[str]) -> Block:
    readings = np.stack([record.time_s[rows], record.table[rows], record.output[rows]])
    time_s = readings[0]
    timed = np.isfinite(time_s)
    start_s = np.min(time_s[timed], initial=np.inf)
    readings = readings[:, ~(time_s < start_s + settle_s)]
    present = np.all(np.abs(readings) < LARGEST_READING, axis=0)
    excluded["missing"] += int(np.sum(~present))
    scheduled = len(np.unique(readings[0][np.isfinite(readings[0])])) + int(np.sum(~timed))
    readings = readings[:, present]
    _, first = np.unique(readings[0], return_index=True)
    excluded["duplicate"] += readings.shape[1] - len(first)
    time_s, table, output = readings[:, first]
    return Block(time_s, table, output, scheduled)


def coarseness(values: Array) -> float:
    """Smallest step between frequent values in `values` (n,): the resolution, if noise is below it.

    0 if no two values are frequent, as in readings with enough noise.
    """
    seen, count = np.unique(values, return_counts=True)
    steps = np.diff(seen[count > COMMON * len(values)])
    return float(np.min(steps)) if len(steps) else 0.0
