"""Cyclic frames: each frame of a leading message is followed by the same others in the same order.

A node on a healthy bus sends in cycles; all its messages are then found from the leading one, without a search.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Message
from drivers.can.frame_block import FrameBlock

T = TypeVar("T", bound=np.generic)


class Cycles(NamedTuple):
    """Start of each cycle in a block of `frames` (N,), and the position of each message in a cycle, by id and length.

    These messages occur nowhere else in the block, except at its head, as the end of the previous cycle; the last cycle
    may be incomplete. If `places` is empty, the frames are not cyclic.
    """

    begins: NDArray[np.intp]
    places: Mapping[tuple[int, int], int]
    frames: int

    def rows(self, message: Message) -> NDArray[np.intp] | None:
        """Rows of a message in the first, second, … cycle; None if it is not in all of them."""
        place = self.places.get((message.id, message.length))
        if place is None:
            return None
        rows: NDArray[np.intp] = self.begins + place
        return rows if rows[-1] < self.frames else rows[:-1]


def cycles_of(block: FrameBlock, begins: NDArray[np.intp]) -> Cycles:
    """Cycles of a block that begin with the frames at `begins` (N,), which are all frames of one message, in order."""
    if not len(begins):
        return Cycles(begins, {}, len(block))
    steps = np.diff(begins, append=len(block))
    first, length = int(begins[0]), int(steps[: max(len(steps) - 1, 1)].min())
    kinds = _kinds(block, first, first + length)
    places = {kind: place for place, kind in enumerate(kinds)}
    tail = int(begins[-1]) if steps[-1] < length else len(block)  # start of an incomplete last cycle
    between = _between(begins, steps, length)
    alike = (
        len(places) == length
        and first < length
        and _kinds(block, 0, first) == kinds[length - first :]
        and _kinds(block, tail, len(block)) == kinds[: len(block) - tail]
        and set(block.ids[between].tolist()).isdisjoint(frame_id for frame_id, _ in kinds)
        and all(_recurs(column[first:tail], between - first, length) for column in (block.ids, block.dlc))
    )
    return Cycles(begins, places if alike else {}, len(block))


def _recurs(column: NDArray[T], between: NDArray[np.intp], length: int) -> bool:
    """Return whether a column repeats from cycle to cycle, frames between cycles ignored."""
    cycles = (np.delete(column, between) if len(between) else column).reshape(-1, length)
    return bool((cycles == column[:length]).all())


def _kinds(block: FrameBlock, begin: int, end: int) -> list[tuple[int, int]]:
    """Messages in a range of rows, by id and length."""
    return list(zip(block.ids[begin:end].tolist(), block.dlc[begin:end].tolist(), strict=True))


def _between(begins: NDArray[np.intp], steps: NDArray[np.intp], length: int) -> NDArray[np.intp]:
    """Rows of frames after the end of a cycle and before the beginning of the next."""
    longer = np.flatnonzero(steps > length)
    extra = steps[longer] - length
    within = np.arange(extra.sum()) - np.repeat(np.cumsum(extra) - extra, extra)
    rows: NDArray[np.intp] = np.repeat(begins[longer] + length, extra) + within
    return rows
