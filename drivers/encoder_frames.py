"""Encoders of tables that are latched with what a CAN node sends: what their frames are, and what they say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Dbc, Field
from drivers.sequence_numbers import Integers, shortest


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


def unwrapped_beside(
    rows: NDArray[np.intp], raw: Integers, bits: int, known_rows: NDArray[np.intp], known: Integers
) -> Integers:
    """Numbers that wrap, in rows of a block, as those nearest to the number of the last `known` row that came before.

    `known` (M,) are unwrapped, in the rows `known_rows` (M,).
    """
    before = np.searchsorted(known_rows, rows) - 1
    near = known[np.maximum(before, 0)] if len(known_rows) else np.zeros_like(raw)
    return near + shortest(raw - near, bits)
