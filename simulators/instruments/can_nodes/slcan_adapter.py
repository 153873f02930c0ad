r"""A serial-line CAN adapter on a simulated bus: takes `C`, `S6`, `O`, sends what a node sends (`t100…\r`)."""

from __future__ import annotations

import asyncio

import numpy as np

from drivers.can.frame_block import ERROR, FrameBlock
from drivers.transport import slcan
from simulators.instruments.can_nodes.can_node import CanNode

SEND_EVERY_S = 0.02
UNREAD_LIMIT_BYTES = 65_536  # frames buffered for a slow client; later ones are lost, as on an adapter


class SimulatedAdapter(asyncio.Protocol):
    """One adapter. Lifetime: a connection; a task of its own sends while the channel is open."""

    def __init__(self, node: CanNode) -> None:
        self._node = node
        self._rest = b""
        self._bitrate_set = False
        self._transport: asyncio.Transport | None = None
        self._sending: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        if isinstance(transport, asyncio.Transport):
            self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Execute commands to the adapter; each is answered by CR, or BEL if it is refused."""
        *commands, self._rest = (self._rest + data).split(slcan.END)
        for command in commands:
            if command and self._transport is not None:
                self._transport.write(slcan.END if self._execute(command) else slcan.REFUSED)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop sending."""
        self._close()
        self._transport = None

    def _execute(self, command: bytes) -> bool:
        if command in slcan.BITRATES.values() and self._sending is None:
            self._bitrate_set = True
            return True
        if command == slcan.OPEN and self._sending is None and self._bitrate_set:
            self._node.take()  # earlier frames on the bus are lost
            self._sending = asyncio.get_running_loop().create_task(self._send())
            return True
        if command == slcan.CLOSE and self._sending is not None:
            self._close()
            return True
        return False

    def _close(self) -> None:
        if self._sending is not None:
            self._sending.cancel()
            self._sending = None

    async def _send(self) -> None:
        while self._transport is not None:
            if self._node.faults.active("cut"):
                self._transport.abort()
                return
            text = slcan.render(_without_errors(self._node.take()))
            if text and self._transport.get_write_buffer_size() < UNREAD_LIMIT_BYTES:
                self._transport.write(text)
            await asyncio.sleep(SEND_EVERY_S)


def _without_errors(block: FrameBlock) -> FrameBlock:
    """Frames without error frames, which the protocol of the adapter does not have."""
    return block.at(np.flatnonzero((block.ids & np.uint32(ERROR)) == 0))
