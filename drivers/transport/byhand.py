"""Connections on which a console can send between the exchanges of a driver."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from drivers.discovery.questions import Listener
from drivers.errors import LinkLost
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.tap import Tap
from drivers.transport.wires import Wires

P = TypeVar("P", bound=asyncio.Protocol)


class SharedLine(Tap):
    """A driver's connection; while the console uses it, the console receives the data."""

    def __init__(self, inner: asyncio.Protocol) -> None:
        super().__init__(inner)
        self.lost = False
        self._listener: Listener | None = None

    async def exchange(self, data: bytes, answer_s: float) -> bytes:
        """Send bytes unchanged; return the answer up to a silence of the line."""
        self._listener = Listener()
        self._listener.lost = ""  # it listens to a connection that is open
        try:
            self.line.write(data)
            return await self._listener.until_quiet(answer_s)
        finally:
            self._listener = None

    def received(self, data: bytes) -> None:
        """Pass bytes to the present user."""
        if self._listener is not None:
            self._listener.data_received(data)
        else:
            super().received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on that the connection is closed."""
        self.lost = True
        if self._listener is not None:
            self._listener.connection_lost(exc)
        super().connection_lost(exc)


class SharedWires:
    """Wires that keep the connections of one device."""

    def __init__(self, wires: Wires) -> None:
        self._wires = wires
        self._lines: list[SharedLine] = []

    def line(self, device: str) -> SharedLine:
        """Oldest open connection: among several it is the one for queries. Raises LinkLost."""
        for line in self._lines:
            if not line.lost:
                return line
        raise LinkLost(device, "is not connected")

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Connect `factory()` with the other end, so that its connection can be shared."""
        made: list[P] = []

        def shared() -> SharedLine:
            made.append(factory())
            self._lines.append(SharedLine(made[-1]))
            return self._lines[-1]

        await self._wires.stream(device, address, shared)
        return made[-1]

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Open a CAN channel, on which nothing is sent."""
        return await self._wires.frames(device, address)
