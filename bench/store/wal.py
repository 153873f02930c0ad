"""What SQLite passes over without a word: commits in the log beside a database that can no longer be read.

SQLite takes the log up to the first frame whose checksum is wrong. After a power cut that is the last commit, which
nobody was told of; where several commits come after it, the log was damaged.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

_HEADER, _FRAME = 32, 24  # bytes
_MAGIC = 0x377F0682  # with little-endian checksums; one more, with big-endian ones
Sum = tuple[int, int]


def lost_commits(wal: Path) -> int:
    """How many commits of a log cannot be read; 0 where SQLite reads all, or passes over no more than one.

    -1 where the head of the log is damaged, so that none of it is read.
    """
    if not wal.is_file() or wal.stat().st_size <= _HEADER:
        return 0
    data = wal.read_bytes()
    magic, _, page, _, *salts, first, second = struct.unpack(">8I", data[:_HEADER])
    order = ">" if magic & 1 else "<"
    total = _sum((0, 0), data[: _HEADER - 8], order)
    if magic & ~1 != _MAGIC or total != (first, second) or not 512 <= page <= 65536:
        return -1
    readable, lost = True, 0
    for begin, end in pairwise(range(_HEADER, len(data) + 1, _FRAME + page)):
        head, content = data[begin : begin + _FRAME], data[begin + _FRAME : end]
        _, commit, *frame_salts, first, second = struct.unpack(">6I", head)
        if readable:
            total = _sum(_sum(total, head[:8], order), content, order)
            readable = frame_salts == salts and total == (first, second)
        if not readable and frame_salts == salts:
            lost += commit > 0
    return lost if lost > 1 else 0


def _sum(total: Sum, data: bytes, order: str) -> Sum:
    """SQLite's checksum of `data`, continued from `total`."""
    first, second = total
    for even, odd in _pairs(data, order):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return first, second


def _pairs(data: bytes, order: str) -> Iterator[tuple[int, int]]:
    return struct.iter_unpack(f"{order}2I", data)
