"""Connections of the server: none waits for ever, and a new one is always admitted.

Where there are too many, one that waits for the header of a request gives way: the oldest one of the address with the
most, unless it is so new that its header may be on the way. Requests in progress are fewer than connections, see
`bench.web.limits`, so there always is one.
"""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from contextlib import suppress
from typing import Any, Protocol

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

MOST, MOST_EVER = 200, 700
NEW_S = 1.0
HEADER_S, UNREAD_S = 10.0, 20.0
SEND_BUFFER_BYTES = 2**17


class _Waiting(Protocol):
    """Connection that may give way. `waits_since` is None while a request is in progress."""

    transport: asyncio.Transport
    waits_since: float | None


class Connection(H11Protocol):
    """Connection of a client, closed if a header takes longer than HEADER_S, or nothing is read for UNREAD_S."""

    waits_since: float | None = None
    _timer: asyncio.TimerHandle | None = None
    _unread: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as in uvicorn
        """Wait for a header."""
        super().connection_made(transport)
        _bound_buffers(transport)
        self._wait()
        make_room(self.connections)

    def data_received(self, data: bytes) -> None:
        """Wait no longer once a request is in progress."""
        super().data_received(data)
        if self._is_busy():
            self._wait_no_longer()

    def on_response_complete(self) -> None:
        """Wait for the next header."""
        super().on_response_complete()
        if not self._is_busy() and self._timer is None:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop all timers."""
        self._wait_no_longer()
        self.resume_writing()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """Give the client some time to read what it has been sent."""
        super().pause_writing()
        self._unread = self.loop.call_later(UNREAD_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on."""
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None
        super().resume_writing()

    def _is_busy(self) -> bool:
        cycle: RequestResponseCycle | None = self.cycle  # None before the first request
        return cycle is not None and not cycle.response_complete

    def _wait(self) -> None:
        self.waits_since = self.loop.time()
        self._timer = self.loop.call_later(HEADER_S, self.transport.abort)

    def _wait_no_longer(self) -> None:
        self.waits_since = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Handshake(asyncio.Protocol):
    """Connection before TLS is agreed upon; then it becomes that of a client."""

    def __init__(self, server: uvicorn.Server) -> None:
        self._server, self._connections = server, server.server_state.connections
        self._received = bytearray()
        self.waits_since: float | None = None
        self._task: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # TCP
        """Begin the handshake."""
        self.transport = transport
        transport.pause_reading()  # until TLS reads
        loop = asyncio.get_running_loop()
        self.waits_since = loop.time()
        self._connections.add(self)  # type: ignore[arg-type]  # has what it is used for
        make_room(self._connections)
        self._task = loop.create_task(self._secure(transport))

    def data_received(self, data: bytes) -> None:
        """Keep what comes right behind the handshake."""
        self._received += data

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._connections.discard(self)

    def shutdown(self) -> None:
        """End the connection with the server."""
        self.transport.abort()

    async def _secure(self, transport: asyncio.Transport) -> None:
        context = self._server.config.ssl
        assert context is not None  # noqa: S101  it is used with TLS only
        loop = asyncio.get_running_loop()
        with suppress(OSError):
            secured = await loop.start_tls(
                transport, self, context, server_side=True, ssl_handshake_timeout=HEADER_S, ssl_shutdown_timeout=5.0
            )
            self._connections.discard(self)
            if secured is None or secured.is_closing():
                return
            made = connection_of(self._server)
            secured.set_protocol(made)
            made.connection_made(secured)
            if self._received:
                made.data_received(bytes(self._received))
            return
        self._connections.discard(self)
        transport.abort()


def connection_of(server: uvicorn.Server) -> Connection:
    """Return a connection of a server."""
    return Connection(server.config, server.server_state, server.lifespan.state)


def make_room(connections: set[Any]) -> None:
    """Close a waiting connection if there are too many."""
    if len(connections) <= MOST:
        return
    alive: list[_Waiting] = [each for each in connections if not each.transport.is_closing()]
    latest = asyncio.get_running_loop().time() - (NEW_S if len(alive) <= MOST_EVER else 0.0)
    waiting = [each for each in alive if each.waits_since is not None and each.waits_since <= latest]
    number = Counter(_address(each.transport) for each in waiting)
    waiting.sort(key=lambda each: (-number[_address(each.transport)], each.waits_since))
    for victim in waiting[: max(0, len(alive) - MOST)]:
        victim.transport.abort()


def _address(transport: asyncio.Transport) -> str:
    return str((transport.get_extra_info("peername") or ("",))[0])


def _bound_buffers(transport: asyncio.Transport) -> None:
    """Bound what the system keeps for a client that does not read, and how long it keeps it."""
    connection = transport.get_extra_info("socket")
    if connection is not None and connection.family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(UNREAD_S * 1000))
