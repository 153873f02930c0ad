"""Interface of a simulated instrument, and the asyncio protocol that connects it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from simulators.faults.instrument_faults import FaultPlan


class Session(Protocol):
    """One connection to an instrument; it buffers incomplete requests."""

    def feed(self, data: bytes) -> bytes:
        """Take bytes as they arrive, in any portions; return the immediate answer, or b""."""


Later = Callable[[float, Callable[[], bytes]], None]
"""Called with seconds and a function: after that time the instrument sends the result of the function."""


@runtime_checkable
class PatientSession(Session, Protocol):
    """A connection to an instrument with delayed answers."""

    def answer_by(self, later: Later) -> None:
        """Set, before anything else, the callback for later answers."""


class DelayedAnswers:
    """Common part of sessions with delayed answers; without a callback they are never sent."""

    _later: Later = staticmethod(lambda _delay_s, _answer: None)

    def answer_by(self, later: Later) -> None:
        """Set the callback for later answers."""
        self._later = later


class Instrument(Protocol):
    """A simulated instrument: model and responder. It never waits, and reads the world on request."""

    faults: FaultPlan

    def session(self) -> Session:
        """Open a connection."""


class InstrumentProtocol(asyncio.Protocol):
    """Connects a transport to an instrument, unless a fault silences it or cuts the line."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self._session = instrument.session()
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Open a session for the client."""
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
        if isinstance(self._session, PatientSession):
            self._session.answer_by(self._send_later)

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the client."""
        if self._instrument.faults.active("cut") and self._transport is not None:
            self._transport.abort()
            return
        self._instrument.faults.catch_up()
        self._send(self._session.feed(data))

    def connection_lost(self, exc: Exception | None) -> None:
        """Drop later answers, because the client has left."""
        self._transport = None

    def _send(self, answer: bytes) -> None:
        if answer and self._transport is not None and not self._instrument.faults.active("silent"):
            self._transport.write(answer)

    def _send_later(self, delay_s: float, answer: Callable[[], bytes]) -> None:
        asyncio.get_running_loop().call_later(delay_s, self._send_now, answer)

    def _send_now(self, answer: Callable[[], bytes]) -> None:
        if self._transport is not None:
            self._instrument.faults.catch_up()
            data = answer()
            if not self._transport.get_write_buffer_size():  # unread data are not kept for the next client
                self._send(data)


def protocol_factory(instrument: Instrument) -> Callable[[], InstrumentProtocol]:
    """Protocol factory of a server."""
    return lambda: InstrumentProtocol(instrument)
