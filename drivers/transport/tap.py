"""A tap between a connection and its user, where bytes can be recorded and changed."""

from __future__ import annotations

import asyncio
from typing import Any


class Tap(asyncio.Protocol):
    """Passes all data on, both ways, to the protocol `inner` and to the connection.

    Subclasses override `sent` and `received` to record or change data; the connection is `line`.
    """

    def __init__(self, inner: asyncio.Protocol) -> None:
        self.inner = inner
        self.line: asyncio.Transport

    def sent(self, data: bytes) -> None:
        """Handle bytes written by `inner`."""
        self.line.write(data)

    def received(self, data: bytes) -> None:
        """Handle bytes that have arrived for `inner`."""
        self.inner.data_received(data)

    # asyncio.Protocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the connection."""
        if not isinstance(transport, asyncio.Transport):
            raise TypeError("a stream transport is needed")
        self.line = transport
        self.inner.connection_made(TappedTransport(self))

    def data_received(self, data: bytes) -> None:
        """Pass on bytes from the other end."""
        self.received(data)

    def eof_received(self) -> bool | None:
        """Pass on the end of data."""
        return self.inner.eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on that the connection is closed."""
        self.inner.connection_lost(exc)


class TappedTransport(asyncio.Transport):
    """The connection as seen by the inner protocol of a tap."""

    def __init__(self, tap: Tap) -> None:
        super().__init__()
        self._tap = tap

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Pass bytes to the tap."""
        if not self._tap.line.is_closing():
            self._tap.sent(bytes(data))

    def close(self) -> None:
        """Close the connection."""
        self._tap.line.close()

    def abort(self) -> None:
        """Close the connection at once."""
        self._tap.line.abort()

    def is_closing(self) -> bool:
        """Return whether the connection is closed or closing."""
        return self._tap.line.is_closing()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Information on the connection."""
        return self._tap.line.get_extra_info(name, default)

    def get_write_buffer_size(self) -> int:
        """Number of bytes not yet sent."""
        return self._tap.line.get_write_buffer_size()

    def pause_reading(self) -> None:
        """Deliver nothing until `resume_reading`."""
        self._tap.line.pause_reading()

    def resume_reading(self) -> None:
        """Deliver bytes again."""
        self._tap.line.resume_reading()
