"""Wires between drivers and simulated instruments that can be patched while they are in use."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeVar

from drivers.errors import CannotConnect
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, join
from simulators.serving.serve import InstrumentProtocol

P = TypeVar("P", bound=asyncio.Protocol)
BETWEEN_EXCHANGES_S = 1.1  # more than any driver leaves between two of one command


class Heard(NamedTuple):
    """Bytes that reached an instrument, and the device whose driver sent them."""

    speaker: str
    owner: str
    data: bytes


class Panel:
    """Wires that can be patched: by address, the device whose instrument is there now. All that is said is kept."""

    def __init__(self) -> None:
        self.instruments: dict[str, Any] = {}
        self.patched: dict[str, str] = {}
        self.heard: list[Heard] = []
        self._open: list[_End] = []

    def put(self, owner: str, instrument: Any, address: Address) -> None:
        self.instruments[owner], self.patched[str(address)] = instrument, owner

    def swap(self) -> None:
        """Two instruments change their places; every connection is lost."""
        self.patched = dict(zip(self.patched, reversed(self.patched.values()), strict=True))
        ends, self._open = self._open, []
        for end in ends:
            end.hang_up()

    async def quiet(self) -> None:
        """Return when nobody is in the middle of several exchanges: what comes then is seen, not overwritten."""
        said = -1
        while said != len(self.heard):
            said = len(self.heard)
            await asyncio.sleep(BETWEEN_EXCHANGES_S)

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        owner = self.patched[str(address)]
        end = _End(self.instruments[owner], partial(self._hear, device, owner))
        self._open.append(end)
        client = factory()
        join(client, end, Line(latency_s=0.002), str(address))
        return client

    async def frames(self, device: str, address: Address) -> FrameLink:
        raise CannotConnect(device, f"{address} carries no frames")

    def _hear(self, speaker: str, owner: str, data: bytes) -> None:
        self.heard.append(Heard(speaker, owner, data))


class _End(InstrumentProtocol):
    def __init__(self, instrument: Any, hear: Callable[[bytes], None]) -> None:
        super().__init__(instrument)
        self._hear = hear
        self._line: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._line = transport
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        self._hear(data)
        super().data_received(data)

    def hang_up(self) -> None:
        if self._line is not None:
            self._line.abort()
