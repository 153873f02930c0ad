"""A socketcand server on a simulated bus: greets, opens its bus, and sends the frames of a node as texts."""

from __future__ import annotations

import asyncio
import re

from drivers.errors import LinkLost
from drivers.transport.socketcand import HI, OK, RAW_MODE, open_text, render
from simulators.instruments.can_nodes.can_node import CanNode

SEND_EVERY_S = 0.02
UNREAD_LIMIT_BYTES = 65_536  # frames buffered for a slow client; later ones are lost
_TEXT = re.compile(rb"<[^<>]*>")


class SimulatedServer(asyncio.Protocol):
    """One connection to the server of one bus.

    Lifetime: a connection; a task of its own sends once it is in raw mode. Of several clients each gets some frames.
    """

    def __init__(self, node: CanNode, bus: str) -> None:
        self._node, self._bus = node, bus
        self._rest = b""
        self._has_bus = False
        self._transport: asyncio.Transport | None = None
        self._sending: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet the client."""
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
            transport.write(HI)

    def data_received(self, data: bytes) -> None:
        """Receive requests of the client, in any portions."""
        self._rest += data
        while (text := _TEXT.search(self._rest)) is not None and self._transport is not None:
            self._rest = self._rest[text.end() :]
            self._execute(text[0], self._transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop sending."""
        self._transport = None
        if self._sending is not None:
            self._sending.cancel()

    def _execute(self, text: bytes, transport: asyncio.Transport) -> None:
        if not self._has_bus:
            self._has_bus = text == open_text(self._bus)
            transport.write(OK if self._has_bus else b"< error could not open bus >")
            if not self._has_bus:
                transport.close()
        elif text == RAW_MODE and self._sending is None:
            transport.write(OK)
            self._sending = asyncio.get_running_loop().create_task(self._send(transport))
        elif text == b"< echo >":
            transport.write(text)
        elif not text.startswith(b"< send "):  # no other node on a simulated bus
            transport.write(b"< error unknown command >")

    async def _send(self, transport: asyncio.Transport) -> None:
        await asyncio.sleep(SEND_EVERY_S)  # a client may take the answer and the next text for one
        self._node.take()  # earlier frames on the bus are lost
        while not transport.is_closing():
            await asyncio.sleep(SEND_EVERY_S)
            try:
                frames = self._node.take()
            except LinkLost:
                transport.abort()
                return
            if len(frames) and transport.get_write_buffer_size() < UNREAD_LIMIT_BYTES:
                transport.write(render(frames))
