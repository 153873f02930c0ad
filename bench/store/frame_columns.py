"""Columns of a block of frames, by message: what does not change from frame to frame is stored once.

A node sends the same messages again and again; from one to the next of them a few bits change, and most times are that
of the frame before, or one period later. A column of 64-bit integers is stored as it is, or as the differences of
successive ones, whichever changes fewer bits: bytes that are the same in all rows once, the others plane by plane. The
layout is in `docs/how-to/read_raw_data.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import FrameBlock, Kind, Sent
from drivers.can.sorted_block import MOST_MESSAGES, SortedBlock, joined

FEW_BITS = 8  # that change in a column: no other way to store it is tried
NS = 1e9
_HEAD = np.dtype([("instants", "<u4"), ("messages", "<u4")])
_COLUMN = np.dtype(
    [("id", "<u4"), ("frames", "<u4"), ("length", "u1"), ("stored", "u1"), ("planes", "u1"), ("first", "<u8"),
     ("same", "<u8")]
)  # fmt: skip
_BYTES_OF = [[byte for byte in range(8) if planes >> byte & 1] for planes in range(256)]
_Words = NDArray[np.uint64]


class _Stored(IntEnum):
    """Values of a column as they are, or differences of successive ones, read as integers of a byte order."""

    PLAIN = 0
    LITTLE = 1
    BIG = 2


_OF_TIMES: tuple[_Stored, ...] = (_Stored.PLAIN, _Stored.LITTLE)


class MalformedError(ValueError):
    """Bytes that are no columns."""


def columns_of(block: FrameBlock) -> bytes | None:
    """Encode a block; equal frames give equal bytes. None if it has too many messages."""
    found = block.by_message(MOST_MESSAGES)
    if found is None:
        return None
    messages = dict(sorted(found.items()))
    begins = np.flatnonzero(np.concatenate(([True], block.at_s[1:] != block.at_s[:-1])))
    together = np.diff(begins, append=len(block))  # frames that arrived at the same time
    times_ns = np.rint(block.at_s[begins] * NS).astype(np.int64)
    order = np.empty(len(block), np.uint8)
    for number, sent in enumerate(messages.values()):
        order[sent.rows] = number
    columns = [((0, 0), each.view(np.uint64), _OF_TIMES) for each in (together, times_ns)]
    columns += [(kind, sent.words, tuple(_Stored)) for kind, sent in messages.items()]
    described, planes = np.zeros(len(columns), _COLUMN), [order.tobytes()]
    for place, ((frame_id, length), values, ways) in enumerate(columns):
        stored, changing, changes = _fewest_changes(values, ways)
        numbers = [byte for byte in range(8) if changes >> 8 * byte & 0xFF]
        first = values[0].byteswap() if stored is _Stored.BIG else values[0]
        same = changing[0] if len(changing) else 0
        described[place] = (frame_id, len(values), length, stored, sum(1 << each for each in numbers), first, same)
        rows = changing.view(np.uint8).reshape(-1, 8)
        planes += [rows[:, byte].tobytes() for byte in numbers]
    head = np.array((len(begins), len(messages)), _HEAD)
    return b"".join([head.tobytes(), described.tobytes(), *planes])


def _fewest_changes(values: _Words, ways: Sequence[_Stored]) -> tuple[_Stored, _Words, int]:
    """How to store a column so that the fewest bits change; what is then stored, and the bits of it that change."""
    found = []
    for stored in ways:
        of_order = values.byteswap() if stored is _Stored.BIG else values
        changing = values if stored is _Stored.PLAIN else of_order[1:] - of_order[:-1]
        changes = int(np.bitwise_or.reduce(changing) ^ np.bitwise_and.reduce(changing)) if len(changing) else 0
        found.append((stored, changing, changes))
        if changes.bit_count() <= FEW_BITS:
            break
    return min(found, key=lambda each: each[2].bit_count())


class _Part(NamedTuple):
    """One of the blocks that are decoded together: its description, and where its order begins."""

    plain: bytes
    frames: int
    described: NDArray[np.void]
    at: int

    @property
    def kinds(self) -> list[Kind]:
        """Messages by id and length."""
        return list(zip(self.described["id"][2:].tolist(), self.described["length"][2:].tolist(), strict=True))

    @property
    def order(self) -> NDArray[np.uint8]:
        """Number of the message of each frame."""
        return np.frombuffer(self.plain, np.uint8, self.frames, self.at)


def block_of(blocks: Sequence[tuple[bytes, int]]) -> FrameBlock:
    """Decode and join blocks, each of so many frames. Raises MalformedError for what `columns_of` does not return."""
    try:
        parts = [_part(*block) for block in blocks]
        if any(part.kinds != parts[0].kinds for part in parts):
            return joined([_decoded([part]) for part in parts])
        return _decoded(parts)
    except (ValueError, IndexError) as problem:
        raise MalformedError(str(problem)) from problem


def _part(plain: bytes, frames: int) -> _Part:
    instants, messages = np.frombuffer(plain, _HEAD, 1)[0].tolist()
    described = np.frombuffer(plain, _COLUMN, 2 + messages, _HEAD.itemsize)
    counts = described["frames"].astype(np.int64)
    if not (counts[0] == counts[1] == instants <= frames and counts[2:].sum() == frames):
        raise MalformedError("its columns do not have the lengths that fit its number of frames")
    part = _Part(plain, frames, described, _HEAD.itemsize + described.nbytes)
    if len(set(part.kinds)) != messages:
        raise MalformedError("a message is described twice")
    return part


def _decoded(parts: Sequence[_Part]) -> SortedBlock:
    """Decode blocks that have the same messages."""
    counts = np.array([part.described["frames"] for part in parts], np.int64)
    columns = [np.empty(count, np.uint64) for count in counts.sum(axis=0).tolist()]
    ends = np.cumsum(counts, axis=0)
    for part, begins, until in zip(parts, (ends - counts).tolist(), ends.tolist(), strict=True):
        _fill([each[slice(*span)] for each, *span in zip(columns, begins, until, strict=True)], part)
    together, times_ns, *words = (each.view(np.int64) for each in columns)
    frames = sum(part.frames for part in parts)
    if not (together.min() >= 1 and together.max() <= frames == together.sum()):
        raise MalformedError("there is not one time for each frame")
    rows = _rows_by_message(np.concatenate([part.order for part in parts]), counts[:, 2:].sum(axis=0))
    sent = map(Sent, rows, (each.view(np.uint64) for each in words))
    return SortedBlock(np.repeat(times_ns / NS, together), dict(zip(parts[0].kinds, sent, strict=True)))


def _rows_by_message(order: NDArray[np.uint8], counts: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of each message, from the numbers of the messages of all frames."""
    rows, ends = np.argsort(order, kind="stable"), np.cumsum(counts)
    numbers = np.arange(len(counts))
    if (order[rows[ends - counts]] != numbers).any() or (order[rows[ends - 1]] != numbers).any():
        raise MalformedError("it has frames of other messages than it describes")
    return [rows[end - count : end] for end, count in zip(ends.tolist(), counts.tolist(), strict=True)]


def _fill(columns: Sequence[_Words], part: _Part) -> None:
    """Fill the columns of a part."""
    at = part.at + part.frames
    for values, (_, _, _, stored, planes, first, same) in zip(columns, part.described.tolist(), strict=True):
        values.fill(same)
        rows = values[stored != _Stored.PLAIN :].view(np.uint8).reshape(-1, 8)
        for byte in _BYTES_OF[planes]:
            rows[:, byte] = np.frombuffer(part.plain, np.uint8, len(rows), at)
            at += len(rows)
        if stored != _Stored.PLAIN:
            values[:1] = first
            values.cumsum(out=values)
        if stored == _Stored.BIG:
            values.byteswap(inplace=True)
    if at != len(part.plain):
        raise MalformedError("there are bytes after its columns")
