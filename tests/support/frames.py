"""CAN frames typed by hand."""

from __future__ import annotations

from drivers.frame_block import FrameBlock
from drivers.transport import slcan


def frames(*lines: str) -> FrameBlock:
    """Frames as an adapter's lines, `ID LENGTH BYTES`, one every 10 ms."""
    blocks = []
    for number, line in enumerate(lines):
        block, _, junk = slcan.parse(f"t{line.replace(' ', '')}\r".encode(), number / 100)
        assert (len(block), junk) == (1, 0), line
        blocks.append(block)
    return FrameBlock.joined(blocks)
