"""Logs as candump writes them: lines like `(1690000000.000100) can0 123#0A0B`."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.transport.alike import alike, bytes_of, in_order, number_of

PART_BYTES = 2**22  # read at once
MAX_EXACT = 2**53  # larger integers are not exact as floating-point numbers

_LINE = re.compile(
    rb"\((?P<seconds>\d+)\.(?P<fraction>\d+)\) \w+ "
    rb"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?P<data>(?:[0-9A-Fa-f]{2}){0,8})(?: [RT])?"
)


def read(path: Path) -> FrameBlock | None:
    """Read the frames of a log, with its times; None if it has other lines than data frames. Raises OSError."""
    blocks, rest = list[FrameBlock](), b""
    with path.open("rb") as file:
        while part := file.read(PART_BYTES):
            whole, end, rest = (rest + part).rpartition(b"\n")
            if (block := parse(whole + end)) is None:
                return None
            blocks.append(block)
    if rest:
        return None  # the last line has no end
    return FrameBlock.joined(blocks)


def parse(data: bytes) -> FrameBlock | None:
    """Parse whole lines; None if one is no data frame, or its time has too many digits."""
    characters = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(characters == ord("\n"))
    begins = np.concatenate(([0], ends[:-1] + 1)) if len(ends) else ends
    parts = []
    for rows, digits in alike(characters, begins, ends, _LINE):
        id_digits, fraction = digits["id"], digits["fraction"]
        ids = number_of(id_digits, 16)
        time_digits = np.concatenate([digits["seconds"], fraction], axis=1)
        if id_digits.shape[1] == 8 and (ids >> 29).any():
            return None  # an error frame
        if time_digits.shape[1] > 18 or (ticks := number_of(time_digits, 10)).max(initial=0) >= MAX_EXACT:
            return None
        ids |= EXTENDED if id_digits.shape[1] == 8 else 0
        dlc = np.full(len(rows), digits["data"].shape[1] // 2, np.uint8)
        at_s = ticks / 10 ** fraction.shape[1]
        parts.append((rows, FrameBlock(ids.astype(np.uint32), at_s, dlc, bytes_of(digits["data"]))))
    block = in_order(parts) if parts else FrameBlock.empty()
    return block if len(block) == len(ends) else None
