"""A pair of connected transports inside one event loop: the in-process equivalent of a TCP connection or a serial line.

Bytes arrive in order and, with a baud rate, no faster than the line would carry them. Everything runs on the loop's
timers, so it is exact in virtual time.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import NamedTuple, Protocol, runtime_checkable

BITS_PER_BYTE = 10  # start, eight data bits, stop


class Line(NamedTuple):
    """Delays of a connection: round trip, and time to send each byte.

    All latency is applied to the answer, which is indistinguishable from a latency split between query and answer.
    """

    latency_s: float = 0.0
    byte_s: float = 0.0

    @classmethod
    def serial(cls, baud: int, latency_s: float = 0.0) -> Line:
        """Line with `baud` bit/s and ten bits for each byte."""
        return cls(latency_s, BITS_PER_BYTE / baud)


@runtime_checkable
class VirtualLoop(Protocol):
    """An event loop with virtual time."""

    def run_now(self, timer: asyncio.TimerHandle) -> bool:
        """Advance time to a timer and run it, if it is the next event; return whether it was."""


class MemoryTransport(asyncio.Transport):
    """One end of a joined pair; the asyncio contract of a stream transport.

    Lifetime: made in pairs by `join`; closing one end closes the other after written data have arrived.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, line: Line, name: object, peer_name: object) -> None:
        super().__init__({"sockname": name, "peername": peer_name})
        self._loop = loop
        self._run_now = loop.run_now if isinstance(loop, VirtualLoop) else _never
        self._line = line
        self._free_at = 0.0  # when the line has sent all earlier data
        self._under_way: deque[asyncio.TimerHandle] = deque()  # data in transit
        self._waiting: deque[bytes | None] = deque()
        self._paused = False
        self._closing = False
        self._protocol: asyncio.Protocol
        self._peer: MemoryTransport

    def attach(self, protocol: asyncio.Protocol, peer: MemoryTransport) -> None:
        """Set the protocol and the other end; called by `join`."""
        self._protocol, self._peer = protocol, peer

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send `data`; dropped if this end is closing, as by a socket."""
        if not self._closing and data:
            self._send(bytes(data))

    def write_eof(self) -> None:
        """Signal the end of the data to the other end."""
        self._send(None)

    def _send(self, data: bytes | None) -> None:
        now = self._loop.time()
        self._free_at = max(now, self._free_at) + len(data or b"") * self._line.byte_s
        arrives_at = self._free_at + self._line.latency_s
        if arrives_at > now:
            self._under_way.append(self._loop.call_at(arrives_at, self._arrive, data))
        else:
            self._peer.receive(data)

    def _arrive(self, data: bytes | None) -> None:
        self._under_way.popleft()
        self._peer.receive(data)

    def let_arrive(self, before_s: float) -> bool:
        """Deliver data in transit in either direction now, if that is the next event; return whether it was.

        For a task that waits only for this answer: it continues without a timer and an iteration of the loop.
        """
        return self.hand_over(before_s) or self._peer.hand_over(before_s)

    def hand_over(self, before_s: float) -> bool:
        """Deliver the first data sent by this end now, if that is the next event; return whether it was."""
        return bool(self._under_way) and self._under_way[0].when() < before_s and self._run_now(self._under_way[0])

    def receive(self, data: bytes | None) -> None:
        """Receive bytes from the other end; None is its end of file."""
        if self._closing:
            return
        if self._paused or self._waiting:
            self._waiting.append(data)
        elif data is not None:
            self._protocol.data_received(data)
        elif not self._protocol.eof_received():
            self.close()

    def pause_reading(self) -> None:
        """Buffer received data until `resume_reading`."""
        self._paused = True

    def resume_reading(self) -> None:
        """Deliver buffered data, in order."""
        self._paused = False
        self._loop.call_soon(self._deliver_waiting)

    def _deliver_waiting(self) -> None:
        waiting, self._waiting = self._waiting, deque()
        for data in waiting:
            self.receive(data)

    def is_reading(self) -> bool:
        """Return whether received data are delivered at once."""
        return not self._paused and not self._closing

    def is_closing(self) -> bool:
        """Return whether this end is closed or closing."""
        return self._closing

    def can_write_eof(self) -> bool:
        """True: a half-closed connection is possible."""
        return True

    def get_write_buffer_size(self) -> int:
        """0: written data leave at once."""
        return 0

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Do nothing: there is no buffer."""

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Protocol that receives the data of this end."""
        return self._protocol

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Set another protocol for the connection."""
        if not isinstance(protocol, asyncio.Protocol):
            raise TypeError("a stream needs an asyncio.Protocol")
        self._protocol = protocol

    def abort(self) -> None:
        """Close at once."""
        self.close()

    def close(self) -> None:
        """Close this end now and the other when data in transit have arrived; closing twice is harmless."""
        if self._closing:
            return
        self._closing = True
        self._loop.call_soon(self._protocol.connection_lost, None)
        at = max(self._loop.time(), self._free_at) + self._line.latency_s
        self._loop.call_at(at, self._peer.close)


def _never(_timer: asyncio.TimerHandle) -> bool:
    return False


def let_arrive(transport: asyncio.Transport | None, before_s: float) -> bool:
    """As MemoryTransport.let_arrive; False for a connection that leaves this process."""
    return isinstance(transport, MemoryTransport) and transport.let_arrive(before_s)


def join(client: asyncio.Protocol, server: asyncio.Protocol, line: Line, address: object) -> MemoryTransport:
    """Connect two protocols; return the client's transport after both have had `connection_made`."""
    loop = asyncio.get_running_loop()
    near = MemoryTransport(loop, Line(0.0, line.byte_s), ("memory", "client"), address)
    far = MemoryTransport(loop, line, address, ("memory", "client"))
    near.attach(client, far)
    far.attach(server, near)
    client.connection_made(near)
    server.connection_made(far)
    return near
