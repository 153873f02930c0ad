"""A connection to an unknown instrument: queries in any protocol, raw answers."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Literal

from drivers.discovery.recognition import NoSuchRegister
from drivers.protocols.modbus_frames import frames_of, read_request
from drivers.transport.address import Address
from drivers.transport.stream_end import BufferedEnd
from drivers.transport.wires import Wires

ANSWER_S = 1.0
QUIET_S = 0.3  # silence after which an answer is complete; the slowest instrument also needs it before the next query
ANSWER_LIMIT_BYTES = 65_536
LINE_ENDS = (b"\r", b"\n")


class Listener(BufferedEnd):
    """Received bytes of a connection to an unknown instrument."""

    async def until_quiet(self, answer_s: float, quiet_s: float = QUIET_S) -> bytes:
        """Receive until the line was silent for `quiet_s`; b"" if nothing arrives within `answer_s`."""
        wait_s = answer_s
        while not self.lost and len(self.received) < ANSWER_LIMIT_BYTES:
            try:
                async with asyncio.timeout(wait_s):
                    await self.more()
            except (TimeoutError, ConnectionError):
                break
            wait_s = quiet_s
        found = bytes(self.received)
        self.received.clear()
        return found

    def ask(self, question: bytes) -> None:
        """Send a query; what has been received before is discarded."""
        self.received.clear()
        self.write(question)


class QueryPort:
    """A Port of drivers.discovery.recognition on a connection of its own.

    Lifetime: an async context manager; entering raises CannotConnect. `answers` holds all answers so far.
    """

    def __init__(self, wires: Wires, address: Address, unit_id: int) -> None:
        self.unit_id, self.is_serial_line = unit_id, address.is_serial_line
        self.answers: dict[bytes, bytes] = {}
        self._wires, self._address = wires, address
        self._listener: Listener | None = None
        self._no_modbus = False

    async def __aenter__(self) -> QueryPort:
        """Connect, and discard unsolicited data until the line is silent."""
        self._listener = await self._wires.stream("scan", self._address, Listener)
        await self._listener.until_quiet(QUIET_S)
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection."""
        if self._listener is not None:
            self._listener.close()

    async def query(self, question: bytes, *, again: bool = False) -> bytes:
        """See Port.

        The instrument's input buffer may hold an incomplete message, such as one sent at another baud rate. The first
        line of text then only completes it and gets no answer, so it is sent once more.
        """
        if question in self.answers and not again:
            return self.answers[question]
        is_first = not self.answers and self.is_serial_line and question.endswith(LINE_ENDS)
        answer = await self._exchange(question)
        self.answers[question] = answer or (await self._exchange(question) if is_first else b"")
        return self.answers[question]

    async def _exchange(self, question: bytes) -> bytes:
        listener = self._listener
        if listener is None or listener.lost:
            return b""
        listener.ask(question)
        return await listener.until_quiet(ANSWER_S)

    async def registers(self, address: int, count: int, function: Literal[3, 4] = 3) -> Sequence[int]:
        """See Port; without an answer to the first request no other registers are read."""
        if self._no_modbus:
            raise ValueError("no answer")
        frames = frames_of("rtu" if self.is_serial_line else "tcp", self.unit_id)
        received = bytearray(await self.query(frames.request(read_request(address, count, function))))
        try:
            answer = frames.answer(received)
        except ValueError:
            answer = None
        if answer is None:
            self._no_modbus = True
            raise ValueError("no answer in Modbus")
        if answer.isError():
            raise NoSuchRegister(f"refused, exception {answer.exception_code}")
        if len(answer.registers) != count:
            raise ValueError(f"{len(answer.registers)} registers")
        return list(answer.registers)
