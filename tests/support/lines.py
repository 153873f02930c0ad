"""The wire to a simulated instrument that is spoken to in lines: tapped, and cut, muted or garbled on demand."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import CannotConnect
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, join
from simulators.serving.serve import Instrument, InstrumentProtocol

P = TypeVar("P", bound=asyncio.Protocol)


class Tap(InstrumentProtocol):
    """The instrument's end of one connection; it does to requests and answers what the wire says."""

    def __init__(self, wire: TappedWire) -> None:
        super().__init__(wire.instrument)
        self._wire = wire
        self.transport: asyncio.Transport | None = None
        self._request = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self._wire.note(data)
        if self._wire.instrument.faults.active("cut") or self._wire.instrument.faults.active("silent"):
            super().data_received(data)
            return
        if self._wire.lose(data):
            return
        self._request = data
        self._wire.instrument.faults.catch_up()
        answer = self._wire.alter(data, self._session.feed(data))
        if answer and self.transport is not None:
            self.transport.write(answer)

    def _send_later(self, delay_s: float, answer: Callable[[], bytes]) -> None:
        request = self._request
        super()._send_later(delay_s, lambda: self._wire.alter(request, answer()))


class TappedWire:
    """A Wires to one instrument, in memory.

    `requests` is every line that reached the instrument's end. `lose` says which of them it never hears; `alter` makes
    of a request and its answer what is sent back.
    """

    def __init__(self, instrument: Instrument, line: Line | None = None) -> None:
        self.instrument = instrument
        self.line = line or Line(latency_s=0.001)
        self.requests: list[bytes] = []
        self.connections: list[Tap] = []
        self.broken = False
        self._awaited: dict[int, asyncio.Event] = {}
        self.lose: Callable[[bytes], bool] = lambda _request: False
        self.alter: Callable[[bytes, bytes], bytes] = lambda _request, answer: answer

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        if self.broken:
            raise CannotConnect(device, f"no connection to {address}")
        tap = Tap(self)
        self.connections.append(tap)
        client = factory()
        join(client, tap, self.line, str(address))
        return client

    async def frames(self, device: str, address: Address) -> FrameLink:
        raise CannotConnect(device, f"{address} carries no frames")

    def note(self, request: bytes) -> None:
        self.requests.append(request)
        if len(self.requests) in self._awaited:
            self._awaited[len(self.requests)].set()

    async def heard(self, count: int) -> None:
        """Return when so many requests have come."""
        if len(self.requests) < count:
            await self._awaited.setdefault(count, asyncio.Event()).wait()

    def drop(self) -> None:
        """The connection is lost."""
        transport = self.connections[-1].transport
        assert transport is not None
        transport.abort()

    def mute(self, word: bytes) -> None:
        """From now on the answers to requests with `word` in them are lost, though they are carried out."""
        self.alter = lambda request, answer: b"" if word in request else answer

    def garble_once(self, good: bytes, wrong: bytes, *, where: bytes) -> None:
        """The next answer to a request with `where` in it has `wrong` in the place of `good`."""

        def garbled(request: bytes, answer: bytes) -> bytes:
            if where not in request:
                return answer
            assert good in answer, (good, answer)
            self.alter = lambda _request, answer: answer
            return answer.replace(good, wrong, 1)

        self.alter = garbled

    def count(self, word: bytes) -> int:
        """Number of requests with `word` in them."""
        return sum(word in request for request in self.requests)
