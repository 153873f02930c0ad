"""Faults of a CAN bus: frames that are lost, duplicated, late or altered.

The affected frames follow from the random numbers given, so that every failure is reproducible.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import EXTENDED, FrameBlock

FURTHEST_ROWS = 12  # a frame arrives late
MEAN_BURST_ROWS = 20
FOREIGN_IDS = 1 << 11

Rows = NDArray[np.intp]


class FrameFault(StrEnum):
    """Kinds of frame faults."""

    LOST = "lost_frames"  # single frames are lost
    BURST = "lost_bursts"  # no frames for some time
    DOUBLED = "doubled_frames"  # a frame arrives twice
    LATE = "late_frames"  # a frame arrives after later ones
    FOREIGN = "foreign_frames"  # another node sends on this bus
    SHORT = "short_frames"  # a frame has another length
    SWAPPED = "swapped_frames"  # two neighbours have swapped identifiers


@dataclass(frozen=True, slots=True)
class FaultyFrames:
    """Frames after a fault, with the index of each among the sent ones; -1 for one that was not sent.

    `altered` marks those that differ from the sent ones.
    """

    block: FrameBlock
    rows: Rows
    altered: NDArray[np.bool_]


def apply_fault(
    fault: FrameFault, block: FrameBlock, draws: np.random.Generator, share: float, swapped: Collection[int] = ()
) -> FaultyFrames:
    """Apply a fault to a `share` of frames (N,); only frames with ids in `swapped` exchange theirs."""
    hit = draws.random(len(block)) < share
    rows = np.arange(len(block))
    untouched = np.zeros(len(block), dtype=bool)
    match fault:
        case FrameFault.LOST:
            return _reordered(block, rows[~hit])
        case FrameFault.BURST:
            return _reordered(block, rows[~_in_bursts(hit, draws)])
        case FrameFault.DOUBLED:
            return _reordered(block, _moved(np.concatenate([rows, rows[hit]]), len(block), draws))
        case FrameFault.LATE:
            return _reordered(block, _moved(np.concatenate([rows[~hit], rows[hit]]), len(rows) - hit.sum(), draws))
        case FrameFault.FOREIGN:
            return _among_foreign(block, rows[hit], draws)
        case FrameFault.SHORT:
            lengths = np.where(hit, (block.dlc + draws.integers(1, 9, len(block))) % 9, block.dlc).astype(np.uint8)
            data = np.where(np.arange(8) < lengths[:, np.newaxis], block.data, 0).astype(np.uint8)
            return FaultyFrames(FrameBlock(block.ids, block.at_s, lengths, data), rows, hit)
        case FrameFault.SWAPPED:
            able = np.isin(block.ids, list(swapped))
            first = np.flatnonzero(hit[:-1] & able[:-1] & able[1:] & (block.ids[:-1] != block.ids[1:]))
            first = first[np.diff(first, prepend=-2) > 1]  # none is swapped twice
            ids, altered = block.ids.copy(), untouched
            ids[first], ids[first + 1] = block.ids[first + 1], block.ids[first]
            altered[first] = altered[first + 1] = True
            return FaultyFrames(FrameBlock(ids, block.at_s, block.dlc, block.data), rows, altered)


def _reordered(block: FrameBlock, rows: Rows) -> FaultyFrames:
    """Indices of reordered or lost frames; a late frame arrives together with the one before it."""
    moved = block.at(rows)
    if len(rows):
        moved = replace(moved, at_s=np.maximum.accumulate(moved.at_s))
    return FaultyFrames(moved, rows, np.zeros(len(rows), dtype=bool))


def _in_bursts(begins: NDArray[np.bool_], draws: np.random.Generator) -> NDArray[np.bool_]:
    """Mask of rows in bursts; a burst begins as often as a single loss would."""
    lost = np.zeros(len(begins), dtype=bool)
    for row in np.flatnonzero(begins & (draws.random(len(begins)) < 1 / MEAN_BURST_ROWS)):
        lost[row : row + int(draws.geometric(1 / MEAN_BURST_ROWS))] = True
    return lost


def _moved(rows: Rows, in_place: int, draws: np.random.Generator) -> Rows:
    """Rows in an order in which those outside `in_place` arrive some places later than they were sent."""
    places = rows.astype(float)
    places[in_place:] += 0.5 + draws.integers(0, FURTHEST_ROWS, len(rows) - in_place)
    return rows[np.argsort(places, kind="stable")]


def _among_foreign(block: FrameBlock, after: Rows, draws: np.random.Generator) -> FaultyFrames:
    """Insert frames after some rows, with identifiers that none of the frames has."""
    free = np.setdiff1d(np.arange(FOREIGN_IDS, dtype=np.uint32), block.ids)
    ids = draws.choice(free, len(after)) | np.where(draws.random(len(after)) < 0.5, np.uint32(EXTENDED), np.uint32(0))
    lengths = draws.integers(0, 9, len(after)).astype(np.uint8)
    data = np.where(np.arange(8) < lengths[:, np.newaxis], draws.integers(0, 256, (len(after), 8)), 0)
    whole = FrameBlock.joined(
        [block, FrameBlock(ids.astype(np.uint32), block.at_s[after], lengths, data.astype(np.uint8))]
    )
    rows = np.concatenate([np.arange(len(block)), np.full(len(after), -1)])
    order = np.argsort(np.concatenate([np.arange(len(block)), after + 0.5]), kind="stable")
    return FaultyFrames(whole.at(order), rows[order], rows[order] < 0)
