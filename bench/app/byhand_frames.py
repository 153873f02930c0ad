"""CAN frames of a device, decoded with its DBC and formatted for the console."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from typing import Any

from drivers.can.dbc import Message, dbc_in
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.can.options import DbcOptions
from drivers.capabilities import FrameSource


async def decoded_frames(device: FrameSource, options: Any, for_s: float) -> AsyncIterator[str]:
    """Yield a line for each frame received within `for_s` (s), with the time since the beginning.

    Without a DBC in the options a line has the bytes only.
    """
    by_id = None
    if isinstance(options, DbcOptions):
        by_id = {message.id: message for message in dbc_in(options.dbc).messages.values()}
    loop = asyncio.get_running_loop()
    async with device.acquire(block_s=0.1) as blocks:
        began_s = loop.time()
        async for block in blocks:
            for number in range(len(block)):
                line = _line(block, number, began_s)
                yield line if by_id is None else f"{line} {_decoded(block, number, by_id)}"
            if loop.time() >= began_s + for_s:
                break


def _line(block: FrameBlock, number: int, began_s: float) -> str:
    frame, dlc = int(block.ids[number]), int(block.dlc[number])
    name = f"{frame & ~EXTENDED:08X}" if frame & EXTENDED else f"{frame:03X}"
    return f"{block.at_s[number] - began_s:10.3f} {name}#{block.data[number, :dlc].tobytes().hex().upper()}"


def _decoded(block: FrameBlock, number: int, by_id: Mapping[int, Message]) -> str:
    data, message = block.data[number].tobytes(), by_id.get(int(block.ids[number]))
    if message is None or message.length != int(block.dlc[number]):
        return "not in the DBC"
    values = (
        f"{signal.name} {signal.raw_of(data) * signal.scale + signal.offset:g} {signal.unit}".rstrip()
        for signal in message.signals.values()
    )
    return f"{message.name}: {', '.join(values)}"
