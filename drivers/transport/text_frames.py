"""Frames received as text: buffered as bytes until they are taken, and then parsed in one go."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.can.frame_block import FrameBlock
from drivers.errors import LinkLost
from drivers.transport.alike import Arrivals, Portion
from drivers.transport.frame_link import DURABLE_BLOCK_S
from drivers.transport.stream_end import StreamEnd

Parse = Callable[[bytes, Arrivals], tuple[FrameBlock, bytes, int]]
"""Parses bytes with their times of arrival: frames, rest of an incomplete one, and number of invalid ones."""


class TextFrames(StreamEnd):
    """A connection as a frame link; `adapter` names its other end, `farewell` is sent before it is closed."""

    block_s = DURABLE_BLOCK_S

    def __init__(self, device: str, parse: Parse, adapter: str, farewell: bytes = b"") -> None:
        super().__init__()
        self._device, self._parse, self._adapter, self._farewell = device, parse, adapter, farewell
        self._portions: list[Portion] = []
        self._rest = b""
        self._answer: asyncio.Future[bool] | None = None  # answers to commands before the first frame

    def data_received(self, data: bytes) -> None:
        """Buffer bytes of the adapter, with their time of arrival."""
        now_s = asyncio.get_running_loop().time()
        self._keep(Portion(now_s, now_s, data))

    def _keep(self, portion: Portion) -> None:
        self._portions.append(portion)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the loss of the connection."""
        self.lost = f"{self._adapter} has closed the connection" + (f" ({exc})" if exc else "")
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(LinkLost(self._device, self.lost))

    def take(self) -> FrameBlock:
        """Frames since the last call; LinkLost if there is none and the connection is lost."""
        portions, self._portions = self._portions, []
        if not portions:
            if self.lost:
                raise LinkLost(self._device, self.lost, remedy="Check the adapter's cable, then run again.")
            return FrameBlock.empty()
        data = b"".join([self._rest, *(each.data for each in portions)])
        block, self._rest, _ = self._parse(data, Arrivals.of(portions, len(self._rest)))
        return block

    def close(self) -> None:
        """Close the connection; closing twice is harmless."""
        if self._transport is not None and not self._transport.is_closing():
            if self._farewell:
                self._transport.write(self._farewell)
            self._transport.close()
