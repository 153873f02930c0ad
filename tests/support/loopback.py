"""Servers on this computer, and our client of a socketcand server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.wires import RealWires


async def served(factory: Callable[[], asyncio.Protocol]) -> tuple[asyncio.Server, int]:
    """Serve a protocol; the server and its port."""
    server = await asyncio.get_running_loop().create_server(factory, "127.0.0.1", 0)
    return server, server.sockets[0].getsockname()[1]


async def linked(port: int) -> FrameLink:
    """Open the bus of a socketcand server."""
    return await RealWires().frames("counter", Address.parse(f"socketcand://127.0.0.1:{port}/can0"))


class SaysHi(asyncio.Protocol):
    """Beginning of a socketcand server: its greeting."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        transport.write(b"< hi >")
