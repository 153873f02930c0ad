"""CAN frames of a device, decoded with its DBC and formatted for the console."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from drivers.can.dbc import Dbc, Message
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.can.options import text_of
from drivers.capabilities import FrameSource


async def decoded_frames(device: FrameSource, options: Any, for_s: float) -> AsyncIterator[str]:
    """A line for each frame that comes within `for_s`, with the seconds since it began."""
    dbc = getattr(options, "dbc", None)
    messages = Dbc(text_of(dbc)).messages.values() if isinstance(dbc, Path) else ()
    by_id = {message.id: message for message in messages}
    loop = asyncio.get_running_loop()
    async with device.acquire(block_s=0.1) as blocks:
        began_s = loop.time()
        async for block in blocks:
            for number in range(len(block)):
                yield _line(block, number, began_s, by_id.get(int(block.ids[number])))
            if loop.time() >= began_s + for_s:
                break


def _line(block: FrameBlock, number: int, began_s: float, message: Message | None) -> str:
    frame, dlc = int(block.ids[number]), int(block.dlc[number])
    data = block.data[number].tobytes()
    name = f"{frame & ~EXTENDED:08X}" if frame & EXTENDED else f"{frame:03X}"
    told = f"{block.at_s[number] - began_s:10.3f} {name}#{data[:dlc].hex().upper()}"
    if message is None or message.length != dlc:
        return f"{told} not in the DBC"
    values = (
        f"{signal.name} {signal.raw_of(data) * signal.scale + signal.offset:g} {signal.unit}".rstrip()
        for signal in message.signals.values()
    )
    return f"{told} {message.name}: {', '.join(values)}"
