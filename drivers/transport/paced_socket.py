"""Reading of a socket: by the event loop as portions arrive, but by a timer while many do.

A server may send each of 8,000 texts/s by itself, and a wake-up for a portion costs a hundred times as much as the
parsing of a text.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable

from drivers.transport.alike import Portion

READ_EVERY_S = 0.016  # as the latency timers of serial adapters
MUCH_BYTES = 768  # within READ_EVERY_S: the texts of 1,000 frames/s
READ_BYTES = 2**22  # 10 s of a full bus; a socket of most systems holds less


class PacedSocket:
    """The socket of a transport. What is read here is passed to `keep`, and not to the protocol.

    `end` is called if a reading finds the connection closed before the transport does. A transport without a socket,
    such as one in memory, keeps delivering. Lifetime: that of the transport.
    """

    def __init__(
        self,
        transport: asyncio.Transport,
        keep: Callable[[Portion], object],
        end: Callable[[Exception | None], object],
    ) -> None:
        socket = transport.get_extra_info("socket")
        self._transport, self._keep, self._end = transport, keep, end
        self._descriptor = -1 if socket is None else socket.fileno()
        self._since_s, self._bytes = 0.0, 0  # what the transport has delivered lately
        self._read_s: float | None = None  # the last reading by the timer; None while the transport delivers

    def note(self, portion: Portion) -> None:
        """Note a portion that the transport has delivered; if much has arrived, read by the timer from now on."""
        if portion.at_s - self._since_s > READ_EVERY_S:
            self._since_s, self._bytes = portion.at_s, 0
        self._bytes += len(portion.data)
        if self._bytes > MUCH_BYTES and self._descriptor >= 0:
            self._transport.pause_reading()
            self._read_s = portion.at_s
            self._read_later()

    def read(self) -> int:
        """Read at once what the system has received; return the number of bytes."""
        if self._descriptor < 0 or self._transport.is_closing():  # another file may have the number of a closed one
            return 0
        since_s = now_s = asyncio.get_running_loop().time()
        if self._read_s is not None:
            since_s, self._read_s = self._read_s, now_s
        try:
            data = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return 0
        except OSError as problem:
            self._end(problem)
            return 0
        if not data:
            self._end(None)
            return 0
        self._keep(Portion(since_s, now_s, data))
        return len(data)

    def _read_later(self) -> None:
        asyncio.get_running_loop().call_later(READ_EVERY_S, self._read_in_time)

    def _read_in_time(self) -> None:
        if self.read() > MUCH_BYTES:
            self._read_later()
        else:
            self._read_s = None
            self._transport.resume_reading()
