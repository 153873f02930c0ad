"""Table encoders latched with the data of a CAN node: frame formats and decoding."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, Field
from drivers.can.options import PositionOptions
from drivers.can.sequence_numbers import MAX_LATE, Integers, ascending, shortest

MAX_AHEAD = 8  # numbers by which a frame may be ahead of the next known one


class PositionFormat(NamedTuple):
    """Frame format of the encoder of an axis."""

    position: Field
    sequence: Field


def position_formats(dbc: Dbc, positions: Mapping[str, PositionOptions]) -> dict[str, PositionFormat]:
    """Resolve the signal names of each encoder in the DBC; DbcError names the missing ones."""
    return {
        name: PositionFormat(dbc.field(each.position), dbc.field(each.sequence)) for name, each in positions.items()
    }


def unwrap_by_neighbours(
    rows: NDArray[np.intp], raw: Integers, bits: int, known_rows: NDArray[np.intp], known: Integers
) -> tuple[Integers, NDArray[np.bool_]]:
    """Unwrap numbers in rows of a block by neighbouring known numbers; also return which of them exceed all before.

    `known` (M,) are unwrapped and ascend, in the rows `known_rows` (M,). Each number is unwrapped to the nearest value
    to the known row before it, or to the one after it if that is closer, as after a gap. A number ahead of both belongs
    to no known row and does not count as exceeding.
    """
    if not len(known):
        return raw, ascending(raw)
    place = np.searchsorted(known_rows, rows)
    before, after = known[np.maximum(place - 1, 0)], known[np.minimum(place, len(known) - 1)]
    from_before, from_after = shortest(raw - before, bits), shortest(raw - after, bits)
    is_nearer = np.abs(from_after) < np.abs(from_before)
    numbers = np.where(is_nearer, after + from_after, before + from_before)
    fresh = numbers - after <= np.where(place < len(known), MAX_AHEAD, MAX_LATE)
    fresh[fresh] = ascending(numbers[fresh])
    return numbers, fresh
