"""Blocks of frames as the database keeps them: compressed, with a checksum, in one of two forms.

Longer blocks are stored by message (`frame_columns`), after a first byte BY_MESSAGE. Short ones, those of many
messages, and all of formats 1 and 2 are plain: the columns of all frames one after the other, of 21 bytes a frame. The
plain form has no mark of its own: it begins with the first byte of zlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from bench.errors import StoreError
from bench.store.frame_columns import NS, MalformedError, block_of, columns_of
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import joined

BY_MESSAGE = b"\x01"
FEWEST_BY_MESSAGE = 1000  # frames; of fewer, such as those of a second, plain ones are written and read faster
MOST_PACKED = 1100  # upper bound of the compression ratio of zlib
FRAME_BYTES = 21  # time, identifier, length and payload of one frame
LEAST_BYTES = 1  # of one frame by message: the number of its message


class Content(NamedTuple):
    """Uncompressed bytes of a block: the input of its checksum and of digests. Equal frames give equal bytes."""

    plain: bytes
    by_message: bool


class Packed(NamedTuple):
    """A block as a row of the database has it: compressed, with its number of frames and the CRC-32 of its content."""

    data: bytes
    frames: int
    crc: int


def content_of(block: FrameBlock) -> Content:
    """Encode a block."""
    columns = columns_of(block) if len(block) >= FEWEST_BY_MESSAGE else None
    return Content(_plain(block), by_message=False) if columns is None else Content(columns, by_message=True)


def packed(content: Content, frames: int) -> Packed:
    """Compress a block for storage."""
    data = isal_zlib.compress(content.plain, 1)
    return Packed(BY_MESSAGE + data if content.by_message else data, frames, isal_zlib.crc32(content.plain))


def content_in(block: Packed) -> Content:
    """Decompress a block. Raises StoreError if it is damaged."""
    data: Any
    frames: Any
    data, frames, crc = block
    if not (isinstance(data, bytes) and isinstance(frames, int)):
        raise StoreError(f"a block of {frames} frames is damaged")
    by_message = data[:1] == BY_MESSAGE
    least = (LEAST_BYTES if by_message else FRAME_BYTES) * frames
    if not 0 <= least <= MOST_PACKED * len(data):
        raise StoreError(f"a block of {frames} frames is damaged")
    try:
        plain = isal_zlib.decompress(data[1:] if by_message else data, bufsize=max(least, 1))
    except isal_zlib.error as problem:  # type: ignore[misc]  # the stubs declare an instance where the library has a class
        raise StoreError(f"a block of {frames} frames is damaged ({problem})") from problem
    if isal_zlib.crc32(plain) != crc or not (by_message or len(plain) == FRAME_BYTES * frames):
        raise StoreError(f"a block of {frames} frames is damaged: its checksum is wrong")
    return Content(plain, by_message)


def unpack(block: Packed) -> FrameBlock:
    """Decode a block. Raises StoreError if it is damaged."""
    return unpack_all([block])


def unpack_all(blocks: Sequence[Packed]) -> FrameBlock:
    """Decode and join blocks. Raises StoreError if one is damaged."""
    contents = [(content_in(block), block.frames) for block in blocks]
    parts: list[FrameBlock] = []
    for by_message, some in groupby(contents, key=lambda each: each[0].by_message):
        neighbours = [(content.plain, frames) for content, frames in some]
        parts += [_of_columns(neighbours)] if by_message else [_of_plain(*each) for each in neighbours]
    return joined(parts)


def _of_columns(blocks: Sequence[tuple[bytes, int]]) -> FrameBlock:
    try:
        return block_of(blocks)
    except MalformedError as problem:
        frames = sum(frames for _, frames in blocks)
        raise StoreError(f"a block of {frames} frames is damaged ({problem})") from problem


def _plain(block: FrameBlock) -> bytes:
    """Columns of all frames, with times as differences in ns."""
    times = np.rint(block.at_s * NS).astype("<i8")
    columns = (
        np.diff(times, prepend=np.int64(0)).astype("<i8"),
        block.ids.astype("<u4"),
        block.dlc,
        np.ascontiguousarray(block.data.T),
    )
    return b"".join(column.tobytes() for column in columns)


def _of_plain(plain: bytes, frames: int) -> FrameBlock:
    def column(dtype: str, at_byte: int) -> NDArray[Any]:
        return np.frombuffer(plain, dtype, frames, at_byte * frames)

    payloads = np.frombuffer(plain, np.uint8, 8 * frames, 13 * frames).reshape(8, frames)
    times_s = np.cumsum(column("<i8", 0)) / NS
    return FrameBlock(column("<u4", 8), times_s, column("u1", 12), np.ascontiguousarray(payloads.T))
