"""This program's end of a connection that carries bytes."""

from __future__ import annotations

import asyncio


class StreamEnd(asyncio.Protocol):
    """Base of such an end: its transport, the reason why it is `lost`, and a wait for the next bytes.

    `lost` is "" while the connection is open; a lost one stays lost.
    """

    def __init__(self) -> None:
        self.lost = "not connected"
        self._waiter: asyncio.Future[None] | None = None
        self._transport: asyncio.Transport | None = None

    async def more(self) -> None:
        """Wait for the next bytes; raises the error of a lost connection."""
        if self.lost:
            raise self._loss()
        self._waiter = asyncio.get_running_loop().create_future()
        try:
            await self._waiter
        finally:
            self._waiter = None

    def _loss(self) -> Exception:
        return ConnectionError(self.lost)

    def _end_wait(self, problem: Exception | None = None) -> None:
        """End a wait for bytes, with an error if there is one."""
        if self._waiter is not None and not self._waiter.done():
            if problem is None:
                self._waiter.set_result(None)
            else:
                self._waiter.set_exception(problem)

    # asyncio.Protocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        if not isinstance(transport, asyncio.Transport):
            raise TypeError("a stream transport is needed")
        self._transport, self.lost = transport, ""

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the other end; a derived class keeps them."""
        self._end_wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the loss of the connection, and end the wait for bytes."""
        self.lost = self.lost or f"the connection was closed ({exc or 'by the other end'})"
        self._end_wait(self._loss())


class BufferedEnd(StreamEnd):
    """Such an end that keeps the received bytes in `received`."""

    def __init__(self) -> None:
        super().__init__()
        self.received = bytearray()

    def write(self, data: bytes) -> None:
        """Send bytes."""
        if self._transport is not None:
            self._transport.write(data)

    def close(self) -> None:
        """Close the connection."""
        if self._transport is not None:
            self._transport.close()

    def data_received(self, data: bytes) -> None:
        """Keep received bytes."""
        self.received += data
        super().data_received(data)
