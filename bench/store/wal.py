"""Detection of commits in SQLite's log that SQLite ignores silently because they cannot be read.

SQLite reads the log up to the first frame with a wrong checksum. Checksums are continued from frame to frame, so that
each frame can also be checked by itself. After a power cut only the last commit is wrong: frames are missing, or
sectors were never written. Commits after a wrong one are damage, and so is a wrong commit without an unwritten sector.
The log is created with its full length: zeros after the last frame are space that is not used yet.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

_HEADER, _FRAME, _SECTOR = 32, 24, 512  # bytes
_MAGIC = 0x377F0682  # with little-endian checksums; plus one with big-endian ones
_INNER = (2, 5)  # b-tree pages with a header of 12 bytes; the others have 8
Sum = tuple[int, int]


class UnreadablePart(NamedTuple):
    """Unreadable part of a log: number of whole commits, and whether it is damage or may be due to a power cut.

    `commits` is 0 if only a part of a commit remains, and -1 if the header of the log is wrong.
    """

    commits: int
    damage: bool

    @property
    def in_words(self) -> str:
        """Finding as a sentence, without the name of the file."""
        if self.commits < 0:
            return "its header is damaged: none of its commits can be read"
        if self.commits > 1:
            return f"its last {self.commits} commits cannot be read"
        if self.damage:
            return "its last commit cannot be read: it was written completely and changed afterwards"
        return (
            "its last commit cannot be read. After a power cut, that commit was never acknowledged; "
            "otherwise the end of the log was damaged and that commit is lost"
        )


def unreadable_part(wal: Path) -> UnreadablePart | None:
    """Return the unreadable part of a log, or None if all is readable or there is none. Raises OSError."""
    if not wal.is_file() or wal.stat().st_size <= _HEADER:
        return None
    data = wal.read_bytes()
    magic, _, page, _, *salts, first, second = struct.unpack(">8I", data[:_HEADER])
    order = ">" if magic & 1 else "<"
    total = _sum((0, 0), data[: _HEADER - 8], order)
    if magic & ~1 != _MAGIC or total != (first, second) or not 512 <= page <= 65536:
        return UnreadablePart(-1, damage=True)
    frames = list(_frames(data, page, total, salts, order))
    bad = next((number for number, frame in enumerate(frames) if not frame.right), len(frames))
    read = max((number + 1 for number, frame in enumerate(frames[:bad]) if frame.commits), default=0)
    behind = [number for number, frame in enumerate(frames) if number >= bad and frame.of_log]
    lost = sum(frames[number].commits for number in behind)
    if not behind:
        tail = _HEADER + len(frames) * (_FRAME + page)
        is_cut = bad == len(frames) and _has_salts(data[tail : tail + _FRAME], salts)
        return UnreadablePart(0, damage=False) if is_cut else None
    last = frames[read : behind[-1] + 1]
    end = last[-1].begin + _FRAME + page
    complete = lost == 1 and last[-1].commits and not any(data[end:]) and all(frame.of_log for frame in last)
    written = not any(_is_unwritten(data, frame, page) for frame in last if not frame.right)
    return UnreadablePart(lost, damage=lost > 1 or (complete and written))


class _Frame(NamedTuple):
    """One frame: offset, number of its page, whether it is of this log and ends a commit, and if its sum is right."""

    begin: int
    number: int
    of_log: bool
    commits: bool
    right: bool


def _frames(data: bytes, page: int, total: Sum, salts: list[int], order: str) -> Iterator[_Frame]:
    for begin, end in pairwise(range(_HEADER, len(data) + 1, _FRAME + page)):
        head = data[begin : begin + _FRAME]
        number, commit, *_, first, second = struct.unpack(">6I", head)
        of_log = _has_salts(head, salts)
        found = _sum(_sum(total, head[:8], order), data[begin + _FRAME : end], order) if of_log else None
        total = (first, second)
        yield _Frame(begin, number, of_log, of_log and commit > 0, found == total)


def _has_salts(head: bytes, salts: list[int]) -> bool:
    """Return True if the header of the frame, which may be cut off, has these salts."""
    return len(head) == _FRAME and list(struct.unpack(">6I", head)[2:4]) == salts


def _is_unwritten(data: bytes, frame: _Frame, page: int) -> bool:
    """Return True if a sector of a frame may never have been written: blank, and outside the free part of its page."""
    begin, end = frame.begin + _FRAME, frame.begin + _FRAME + page
    first_free, end_free = _free_part(data[begin:end], frame.number)
    low, high = begin + first_free, begin + end_free
    for sector in range(frame.begin - frame.begin % _SECTOR, end, _SECTOR):
        if not any(data[sector : sector + _SECTOR]) and not low <= sector <= sector + _SECTOR <= high:
            return True
    return False


def _free_part(content: bytes, number: int) -> tuple[int, int]:
    """Return the byte range of a b-tree page between its pointers and its cells; empty for other pages."""
    has_header = number == 1 or content.startswith(b"SQLite format 3\0")  # either may be damaged
    head = 100 if has_header else 0
    kind, _, cells, begin, _ = struct.unpack(">B3HB", content[head : head + 8])
    if not kind:
        return 0, 0
    return head + (12 if kind in _INNER else 8) + 2 * cells, begin or 65536


def _sum(total: Sum, data: bytes, order: str) -> Sum:
    """Return SQLite's checksum of `data`, continued from `total`."""
    first, second = total
    for even, odd in struct.iter_unpack(f"{order}2I", data):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return first, second
