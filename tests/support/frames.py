"""CAN frames typed by hand, those of a counter, and frames taken from a link in real time."""

from __future__ import annotations

import asyncio

import numpy as np

from drivers.can.dbc import encode_frames
from drivers.can.frame_block import FrameBlock
from drivers.can.sorted_block import SortedBlock
from drivers.transport import slcan
from drivers.transport.alike import Arrivals
from drivers.transport.frame_link import FrameLink
from tests.support.laboratory import DBC


def frames(*lines: str) -> FrameBlock:
    """Frames as an adapter's lines, `ID LENGTH BYTES`, one every 10 ms."""
    blocks = []
    for number, line in enumerate(lines):
        block, _, junk = slcan.parse(f"t{line.replace(' ', '')}\r".encode(), Arrivals.at_once(number / 100))
        assert (len(block), junk) == (1, 0), line
        blocks.append(block)
    return FrameBlock.joined(blocks)


async def taken(link: FrameLink, count: int, within_s: float = 2.0) -> FrameBlock:
    """Frames received once there are `count`; fails after `within_s`."""
    blocks: list[FrameBlock] = []
    async with asyncio.timeout(within_s):
        while sum(map(len, blocks)) < count:
            blocks.append(link.take())
            await asyncio.sleep(0.01)
    return FrameBlock.joined(blocks)


def counted(latches: int) -> FrameBlock:
    """A healthy counter: a latch and the counts of a channel a hundred times a second, with noise of a pulse."""
    number = np.arange(latches)
    pulses = np.cumsum(999 + number * number * 7919 % 101 % 3)
    values = {
        "Latch": {"Tick": 10_000 * number, "Sequence": number & 0xFFFF},
        "AxisX": {"Positive": pulses & 0xFFFFFF, "Sequence": number & 0xFFFF},
    }
    return encode_frames(DBC, (5 * 10**9 + 10**7 * number) / 1e9, values)


def in_order_of_messages(block: FrameBlock) -> SortedBlock:
    """The same frames, sorted by message."""
    messages = block.by_message(len(block))
    assert messages is not None
    return SortedBlock(block.at_s, messages)
