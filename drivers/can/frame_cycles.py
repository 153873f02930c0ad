"""Frames that come in cycles: after each one of a message the same others, in the same order.

So a node on a healthy bus sends, and then all messages are found by the one that leads them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Message
from drivers.can.frame_block import FrameBlock

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Cycles:
    """Where cycles begin in a block of `frames` (N,), and how far behind a message stands, by its id and its length.

    Nowhere else is any of these messages, but for those at the head of the block that ended the cycle before it; the
    last cycle may lack its end. Without `places` the frames come otherwise.
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
    """The cycles of a block that begin with the frames at `begins` (N,), all those of one message, in order."""
    if not len(begins):
        return Cycles(begins, {}, len(block))
    steps = np.diff(begins, append=len(block))
    first, length = int(begins[0]), int(steps[: max(len(steps) - 1, 1)].min())
    kinds = _kinds(block, first, first + length)
    places = {kind: place for place, kind in enumerate(kinds)}
    tail = int(begins[-1]) if steps[-1] < length else len(block)  # where a cycle begins that lacks its end
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
    """Whether a column, without what comes between cycles, is that of one cycle again and again."""
    cycles = (np.delete(column, between) if len(between) else column).reshape(-1, length)
    return bool((cycles == column[:length]).all())


def _kinds(block: FrameBlock, begin: int, end: int) -> list[tuple[int, int]]:
    """The messages in a stretch of rows, by their ids and lengths."""
    return list(zip(block.ids[begin:end].tolist(), block.dlc[begin:end].tolist(), strict=True))


def _between(begins: NDArray[np.intp], steps: NDArray[np.intp], length: int) -> NDArray[np.intp]:
    """The rows of frames after the end of a cycle and before the next one begins."""
    longer = np.flatnonzero(steps > length)
    extra = steps[longer] - length
    within = np.arange(extra.sum()) - np.repeat(np.cumsum(extra) - extra, extra)
    rows: NDArray[np.intp] = np.repeat(begins[longer] + length, extra) + within
    return rows
