"""Frames that come in cycles: after each one of a message the same others, in the same order.

So a node on a healthy bus sends, and then all messages are found by the one that leads them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Message
from drivers.frame_block import FrameBlock


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
        """Where a message stands in the first, second, … cycle; None when it is not in all of them."""
        place = self.places.get((message.id, message.length))
        if place is None:
            return None
        rows: NDArray[np.intp] = self.begins + place
        return rows if rows[-1] < self.frames else rows[:-1]


def cycles_of(block: FrameBlock, begins: NDArray[np.intp]) -> Cycles:
    """The cycles of a block that begin with the frames at `begins` (N,), all those of one message, in order."""
    if len(begins) < 2:
        return Cycles(begins, {}, len(block))
    steps = np.diff(begins, append=len(block))
    first, length = int(begins[0]), int(steps[:-1].min())
    ids, dlc = block.ids[first : first + length], block.dlc[first : first + length]
    places = {kind: place for place, kind in enumerate(zip(ids.tolist(), dlc.tolist(), strict=True))}
    alike = (
        len(places) == length
        and _ends_with(ids, block.ids[:first])
        and all(_are_alike(block, begins + place) for place in range(1, length))
        and not np.isin(block.ids[_between(begins, steps, length)], ids).any()
    )
    return Cycles(begins, places if alike else {}, len(block))


def _ends_with(ids: NDArray[np.uint32], head: NDArray[np.uint32]) -> bool:
    return len(head) < len(ids) and bool((ids[len(ids) - len(head) :] == head).all())


def _are_alike(block: FrameBlock, rows: NDArray[np.intp]) -> bool:
    """Whether one message stands in all these rows, the last of which may be past the end of the block."""
    if rows[-1] >= len(block):
        rows = rows[:-1]
    first = rows[0]
    return bool((block.ids.take(rows) == block.ids[first]).all() and (block.dlc.take(rows) == block.dlc[first]).all())


def _between(begins: NDArray[np.intp], steps: NDArray[np.intp], length: int) -> NDArray[np.intp]:
    """The rows of frames after the end of a cycle and before the next one begins."""
    longer = np.flatnonzero(steps > length)
    extra = steps[longer] - length
    within = np.arange(extra.sum()) - np.repeat(np.cumsum(extra) - extra, extra)
    rows: NDArray[np.intp] = np.repeat(begins[longer] + length, extra) + within
    return rows
