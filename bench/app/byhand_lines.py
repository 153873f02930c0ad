"""Console input for an instrument, sent over the driver's own connection."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from typing import Protocol

from bench.config.devices import DeviceEntry
from drivers.discovery.recognition import MODBUS
from drivers.errors import BadAnswer, NoAnswer
from drivers.protocols.modbus_frames import Framing, Pdu, ReadFunction, frames_of, read_request, write_request
from drivers.transport.byhand import SharedWires
from drivers.transport.exchange import LineExchange

QUESTION_S, COMMAND_S, MODBUS_S = 5.0, 1.0, 3.0  # timeouts of an answer
_SMALL, _LARGE = 1e-6, 1e9  # a float32 beyond is implausible, or has the other word order
_LARGEST, _WORDS_AT_MOST = 0xFFFF, 100
_NUMBER = r"\s+(?:0x[0-9a-f]{1,4}|0|[1-9]\d{0,4})"
_READ = re.compile(rf"(?:read|input){_NUMBER}(?:{_NUMBER})?", re.IGNORECASE | re.ASCII)
_WRITE = re.compile(rf"write{_NUMBER}(?:{_NUMBER}){{1,{_WORDS_AT_MOST}}}", re.IGNORECASE | re.ASCII)


class Unsendable(Exception):
    """Line that cannot be sent, with the reason."""


class LineProtocol(Protocol):
    """Protocol of console lines. With `twice`, a line that is not a query must be typed twice."""

    help: str
    twice: bool

    def is_query(self, line: str) -> bool | None:
        """Return True if a line is a query, None if unknown. Raises Unsendable for an invalid line."""

    async def send(self, line: str, *, is_question: bool) -> Sequence[str]:
        """Send the line; return the text to print besides the bytes. Raises a DriverError."""


def line_protocol_of(role: str, entry: DeviceEntry, wires: SharedWires) -> LineProtocol:
    """Return the console protocol of the instrument of an entry."""
    recognition = entry.description.recognised_by()
    if recognition is not None and recognition.language is MODBUS:
        return ModbusLines(role, entry, wires)
    return TextLines(role, entry, wires)


class TextLines:
    """Text lines, framed as by the driver."""

    help = "A line is sent unchanged in the instrument's own protocol, with the line end that its driver uses."
    twice = False

    def __init__(self, role: str, entry: DeviceEntry, wires: SharedWires) -> None:
        self._role, self._wires = role, wires
        recognition = entry.description.recognised_by()
        self._is_query = recognition.language.is_query if recognition is not None else None

    def is_query(self, line: str) -> bool | None:
        """See LineProtocol."""
        return None if self._is_query is None else self._is_query(line)

    async def send(self, line: str, *, is_question: bool) -> Sequence[str]:
        """Exchange a line; a missing answer is no error, because commands have none."""
        exchange = self._wires.line(self._role).inner
        if not isinstance(exchange, LineExchange):
            raise Unsendable("no command can be typed for this instrument; use the commands of its driver, see :help")
        try:
            data = line.encode("latin-1")
        except UnicodeEncodeError:
            raise Unsendable("not sent: it contains a character that the instrument does not support") from None
        try:
            await exchange.query(data, bytes, answer_s=QUESTION_S if is_question else COMMAND_S)
        except NoAnswer:
            if is_question:
                raise
            return [f"no answer within {COMMAND_S:g} s (usual for a command that is not a query)"]
        return []


class ModbusLines:
    """Requests for registers, in text form, on the driver's connection."""

    help = (
        "read ADDRESS [COUNT]      holding registers, by their address on the wire, such as 2782 or 0x0ade\n"
        "input ADDRESS [COUNT]     input registers\n"
        "write ADDRESS WORD...     with --write; typed twice"
    )
    twice = True

    def __init__(self, role: str, entry: DeviceEntry, wires: SharedWires) -> None:
        self._role, self._wires = role, wires
        self._unit_id: int = getattr(entry.options, "unit_id", 1)
        self._framing: Framing = "rtu" if entry.connection.is_serial_line else "tcp"

    def is_query(self, line: str) -> bool:
        """See LineProtocol."""
        verb, _ = _parsed(line)
        return verb != "write"

    async def send(self, line: str, *, is_question: bool) -> Sequence[str]:
        """Send one request; return its registers as text."""
        verb, numbers = _parsed(line)
        frames = frames_of(self._framing, self._unit_id)
        sent = frames.request(_request(verb, numbers))
        received = await self._wires.line(self._role).exchange(sent, MODBUS_S)
        if not received:
            raise NoAnswer(self._role, f"no answer within {MODBUS_S:g} s", sent=line)
        try:
            answer = frames.answer(bytearray(received))
        except ValueError as problem:
            raise BadAnswer(self._role, f"not an answer: {problem}", sent=line) from problem
        if answer is None:
            raise BadAnswer(self._role, "incomplete answer", sent=line)
        if answer.isError():
            return [f"refused, exception {answer.exception_code}"]
        return [_words(numbers[0], answer.registers)] if is_question else ["acknowledged"]


def _parsed(line: str) -> tuple[str, list[int]]:
    """Return the verb and the numbers of a line. Raises Unsendable."""
    match = _READ.fullmatch(line) or _WRITE.fullmatch(line)
    if match is None:
        raise Unsendable("expected read ADDRESS [COUNT], input ADDRESS [COUNT] or write ADDRESS WORD...; see :help")
    verb, *texts = line.lower().split()
    numbers = [int(text, 0) for text in texts]
    if max(numbers) > _LARGEST:
        raise Unsendable(f"an address or a word is more than {_LARGEST}")
    if verb != "write" and len(numbers) == 2 and not 1 <= numbers[1] <= _WORDS_AT_MOST:
        raise Unsendable(f"from 1 to {_WORDS_AT_MOST} registers can be read at once")
    return verb, numbers


def _request(verb: str, numbers: Sequence[int]) -> Pdu:
    if verb == "write":
        return write_request(numbers[0], numbers[1:], many=len(numbers) > 2)
    function: ReadFunction = 3 if verb == "read" else 4
    return read_request(numbers[0], numbers[1] if len(numbers) > 1 else 1, function)


def _words(address: int, registers: Sequence[int]) -> str:
    """Return registers as numbers; two of them as a float32 as well, if plausible."""
    text = f"{address}: {' '.join(map(str, registers))} (hexadecimal {' '.join(f'{word:04x}' for word in registers)})"
    if len(registers) != 2:
        return text
    pairs = {"low word first": registers[::-1], "high word first": registers}
    values = {name: struct.unpack(">f", struct.pack(">HH", *pair))[0] for name, pair in pairs.items()}
    floats = [f"{value:.7g} {name}" for name, value in values.items() if value == 0 or _SMALL < abs(value) < _LARGE]
    return f"{text}; as float32 {' or '.join(floats)}" if floats else text
