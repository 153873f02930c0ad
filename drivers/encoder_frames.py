"""Encoders of tables that are latched with what a CAN node sends: what their frames are, and what they say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Dbc, Field
from drivers.sequence_numbers import MOST_LATE, Integers, ascending, shortest


@dataclass(frozen=True, slots=True)
class PositionFormat:
    """The encoder of an axis."""

    position: Field
    sequence: Field


@dataclass(frozen=True, slots=True)
class Positions:
    """One encoder as the wire gave it, a row for each latch whose frames all came; `position` wraps.

    `sequence` (N,) numbers the latches, or the samples, that they belong to; `tick` (N,) is raw, `host_s` (N,) is when
    these arrived. `lost` counts those whose frames did not all come, `restarts` changes of a boot counter.
    """

    sequence: Integers
    tick: Integers
    position: Integers
    host_s: NDArray[np.float64]
    tick_bits: int
    position_bits: int
    lost: int
    restarts: int


def position_formats(dbc: Dbc, positions: Mapping[str, Mapping[str, Any]]) -> dict[str, PositionFormat]:
    """Binds the names of each encoder to the DBC; DbcError names what it does not have."""
    return {
        name: PositionFormat(dbc.field(entry["position"]), dbc.field(entry["sequence"]))
        for name, entry in positions.items()
    }


def numbered_beside(
    rows: NDArray[np.intp], raw: Integers, bits: int, known_rows: NDArray[np.intp], known: Integers
) -> tuple[Integers, NDArray[np.bool_]]:
    """Numbers that wrap, in rows of a block, unwrapped; and which of them are above all before them.

    `known` (M,) are unwrapped, in the rows `known_rows` (M,). A number is the nearest one to that of the known row
    before it, or to that of the one after it where that is nearer, as after a gap. One that is far ahead of both is of
    nobody known, and not among those above.
    """
    if not len(known):
        return raw, ascending(raw)
    after = np.searchsorted(known_rows, rows)
    before = np.maximum(after - 1, 0)
    steps = [shortest(raw - known[near], bits) for near in (before, np.minimum(after, len(known) - 1))]
    is_after = np.abs(steps[1]) < np.abs(steps[0])
    step = np.where(is_after, steps[1], steps[0])
    numbers = step + np.where(is_after, known[np.minimum(after, len(known) - 1)], known[before])
    fresh = step <= MOST_LATE
    fresh[fresh] = ascending(numbers[fresh])
    return numbers, fresh
