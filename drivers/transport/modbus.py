"""Registers over Modbus: TCP, a serial line (RTU), or a serial line behind a TCP serial server."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from drivers.errors import BadAnswer, CannotConnect, DriverError, LinkLost, NoAnswer, Refused
from drivers.protocols.modbus_frames import Frames, Framing, Pdu, ReadFunction, frames_of, read_request, write_request
from drivers.timing.awake import fair_timeout
from drivers.transport.address import Address
from drivers.transport.exchange import printable_hex
from drivers.transport.memory import let_arrive
from drivers.transport.stream_end import BufferedEnd
from drivers.transport.wires import Wires

GAP_S = 0.03  # silence that a controller on a serial line needs between an answer and the next request
QUIET_S = 0.5  # after such a silence of a serial line a late answer is no longer expected
DRAINS = 10  # number of such silences to wait for
_EXCEPTIONS = {  # code: (meaning, remedy)
    1: ("illegal function", "Check that the driver fits the instrument."),
    2: ("no such register", "Check that the driver, and its options in the bench file, fit the instrument."),
    3: ("illegal value", "Check the limits and locks that are set at the instrument."),
    4: ("device failure", "Look at the instrument for an error."),
    5: ("acknowledged, still busy", "Wait until the instrument is ready, then start again."),
    6: ("busy", "Wait until the instrument is ready, then start again."),
    10: ("gateway path unavailable", "Check the unit id in the bench file and the gateway."),
    11: ("gateway target did not respond", "Check the unit id in the bench file and the wire behind the gateway."),
}


class ModbusLink:
    """Registers of one unit on one connection.

    Every request is sent once. After a timeout, an answer that does not fit or a cancelled request the connection is
    closed; its owner reopens it and first verifies the identity. Over TCP answers are numbered, and a late one is
    dropped; a serial line is drained when it is opened.

    Concurrency: one request at a time; callers queue.
    """

    def __init__(
        self, device: str, wires: Wires, address: Address, *, unit_id: int, answer_s: float = 3.0,
        gap_s: float = GAP_S,
    ) -> None:  # fmt: skip
        self.device, self.address, self._wires = device, address, wires
        self.framing: Framing = "rtu" if address.is_serial_line else "tcp"
        self._unit_id, self._answer_s = unit_id, answer_s
        self._gap_s = gap_s if address.is_serial_line else 0.0
        self._turn = asyncio.Lock()
        self._stream: _Stream | None = None
        self._frames: Frames = frames_of(self.framing, unit_id)

    async def open(self) -> None:
        """Connect or reconnect; raises CannotConnect, and BadAnswer for a line that is never silent."""
        self.close()
        try:
            async with fair_timeout(self._answer_s) as limit:
                stream = await self._wires.stream(self.device, self.address, _Stream)
        except TimeoutError as problem:
            if not limit.expired():
                raise
            raise CannotConnect(
                self.device, f"no connection to {self.address}",
                remedy="Check that the controller is on, its network address, and the port in the bench file.",
            ) from problem  # fmt: skip
        self._frames = frames_of(self.framing, self._unit_id)
        self._stream = stream
        if self.framing == "rtu":
            await self._drain(stream)

    @property
    def is_open(self) -> bool:
        """True from opening to closing; a connection closed by the other end is noticed at the next request."""
        return self._stream is not None

    async def read(self, address: int, count: int, *, function: ReadFunction = 3) -> tuple[int, ...]:
        """Read `count` holding registers, or input registers by function 4, from the wire address `address`.

        Raises NoAnswer after the time for an answer, Refused for a Modbus exception, BadAnswer, LinkLost.
        """
        sent = f"read {count} register{'s' if count != 1 else ''} at {address}"
        answer = await self._answer(read_request(address, count, function), sent)
        if len(answer.registers) != count:
            raise self._misfit(f"{len(answer.registers)} registers", sent)
        return tuple(answer.registers)

    async def write(self, address: int, words: Sequence[int], *, many: bool = False) -> None:
        """Write registers from the wire address `address` in one request; raises as `read`.

        One register goes by function 6, or by 16 with `many`. After NoAnswer and LinkLost it is unknown whether it was
        executed: read back, then decide.
        """
        sent = f"write {' '.join(f'{word:04x}' for word in words)} at {address}"
        request = write_request(address, words, many=many)
        answer = await self._answer(request, sent)
        told = answer.registers[0] if answer.function_code == request.function_code == 6 else answer.count
        if (answer.address, told) != (address, words[0] if request.function_code == 6 else len(words)):
            raise self._misfit(str(answer), sent)

    def close(self) -> None:
        """Close the connection; closing twice is harmless."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    async def _answer(self, request: Pdu, sent: str) -> Pdu:
        """Answer to a request; raises for an exception or an invalid answer."""
        async with self._turn:
            stream = self._open_stream(sent)
            try:
                answer = await self._exchange(stream, request, sent)
            except (DriverError, asyncio.CancelledError):
                self.close()
                raise
        if answer.isError():
            code = answer.exception_code
            meaning, remedy = _EXCEPTIONS.get(code, ("unknown", "Look it up in the instrument's manual."))
            raise Refused(self.device, f"Modbus exception {code}, {meaning}", sent=sent, remedy=remedy)
        return answer

    async def _exchange(self, stream: _Stream, request: Pdu, sent: str) -> Pdu:
        if stream.silent_s < self._gap_s:
            await asyncio.sleep(self._gap_s - stream.silent_s)
        if stream.received and self.framing == "rtu":
            raise self._misfit(f"{printable_hex(stream.received)} before the request", sent)
        until_s = asyncio.get_running_loop().time() + self._answer_s
        stream.write(self._frames.request(request))
        try:
            while (answer := self._frames.answer(stream.received)) is None and stream.let_arrive(until_s):
                pass
            if answer is not None:  # for a simulator in this process, which saves a timer
                return answer
            async with fair_timeout(until_s - asyncio.get_running_loop().time()):
                while (answer := self._frames.answer(stream.received)) is None:
                    await stream.more()
        except TimeoutError:
            raise NoAnswer(
                self.device, f"no answer within {self._answer_s:g} s from {self.address}", sent=sent,
                received=printable_hex(stream.received),
                remedy="Check that the controller is on and that its cable is connected.",
            ) from None  # fmt: skip
        except ConnectionError as problem:
            raise self._lost("was closed", sent) from problem
        except ValueError as problem:
            raise self._misfit(str(problem), sent) from problem
        return answer

    async def _drain(self, stream: _Stream) -> None:
        """Discard late answers on a serial line."""
        for _ in range(DRAINS):
            await asyncio.sleep(QUIET_S)
            if stream.silent_s >= QUIET_S:
                stream.received.clear()
                return
        self.close()
        raise BadAnswer(
            self.device, f"the line at {self.address} is not silent within {DRAINS * QUIET_S:g} s",
            received=printable_hex(stream.received),
            remedy="Check that no other program or display polls on this line, and the line settings.",
        )  # fmt: skip

    def _open_stream(self, sent: str) -> _Stream:
        if self._stream is None or self._stream.lost:
            self.close()
            raise self._lost("is closed", sent)
        return self._stream

    def _lost(self, how: str, sent: str) -> LinkLost:
        return LinkLost(
            self.device, f"the connection to {self.address} {how}", sent=sent,
            remedy="Check the cable, and whether the instrument was restarted.",
        )  # fmt: skip

    def _misfit(self, received: str, sent: str) -> BadAnswer:
        self.close()
        return BadAnswer(
            self.device, "the answer does not fit the request", sent=sent, received=received,
            remedy="Check what is at this address, and that no gateway mixes up its clients.",
        )  # fmt: skip


class _Stream(BufferedEnd):
    """Received bytes of a connection, and the time of the last."""

    def __init__(self) -> None:
        super().__init__()
        self._received_at_s = asyncio.get_running_loop().time()

    @property
    def silent_s(self) -> float:
        """Time since the last received byte."""
        return asyncio.get_running_loop().time() - self._received_at_s

    def let_arrive(self, before_s: float) -> bool:
        """Deliver data of a simulator in this process, if that is the next event; return whether it was."""
        return let_arrive(self._transport, before_s)

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the instrument."""
        self._received_at_s = asyncio.get_running_loop().time()
        super().data_received(data)
