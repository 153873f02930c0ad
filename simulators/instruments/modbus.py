"""Modbus server: requests from a stream of bytes, answers of registers or exceptions.

Frames are those of the Modbus application protocol. Over TCP: transaction (2 bytes), protocol 0 (2), length of the rest
(2), unit (1), function (1), data. On a serial line: unit (1), function (1), data, checksum (2, low byte first).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from simulators.serving.serve import Later

_HEADER = struct.Struct(">HHHB")  # transaction, protocol, length of the rest, unit
_TWO_WORDS = struct.Struct(">HH")
_LONGEST = 254  # the unit and 253 bytes of function and data
_READ_LIMIT, _WRITE_LIMIT = 125, 123  # registers in one request
_ADDRESSES = 0x10000

_FRAME_END_S = 0.05

READ, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16


class ExceptionCode(IntEnum):
    """Exception codes of refused requests."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_ADDRESS = 2
    ILLEGAL_VALUE = 3
    DEVICE_FAILURE = 4


class RegisterError(Exception):
    """A request that registers refuse, with the code for the client."""

    def __init__(self, code: ExceptionCode) -> None:
        super().__init__(code.name.lower().replace("_", " "))
        self.code = code


class Registers(Protocol):
    """Interface of the registers of a server."""

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read `count` words from `address`; raises RegisterError."""

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write words from `address` on, all or none; raises RegisterError."""


@dataclass(frozen=True, slots=True)
class ModbusServer:
    """Registers of a unit number; `functions` are the supported ones.

    Input registers are those of `inputs`; without it they equal the holding registers.
    """

    registers: Registers
    unit_id: int
    functions: frozenset[int] = frozenset({READ, WRITE_ONE, WRITE_MANY})
    inputs: Registers | None = None

    def answer(self, request: bytes) -> bytes:
        """Answer to a request, both as function and data; may be an exception."""
        function, data = request[0], request[1:]
        try:
            if function not in self.functions:
                raise RegisterError(ExceptionCode.ILLEGAL_FUNCTION)
            if function in (READ, READ_INPUT):
                return bytes([function]) + self._read(data, self.inputs if function == READ_INPUT else None)
            return bytes([function]) + (self._write_one(data) if function == WRITE_ONE else self._write_many(data))
        except RegisterError as refusal:
            return bytes([function | 0x80, refusal.code])

    def _read(self, data: bytes, inputs: Registers | None) -> bytes:
        address, count = _two_words(data)
        _check(1 <= count <= _READ_LIMIT, ExceptionCode.ILLEGAL_VALUE)
        _check(address + count <= _ADDRESSES, ExceptionCode.ILLEGAL_ADDRESS)
        words = (inputs or self.registers).read(address, count)
        return struct.pack(f">B{count}H", 2 * count, *words)

    def _write_one(self, data: bytes) -> bytes:
        address, word = _two_words(data)
        self.registers.write(address, (word,))
        return data

    def _write_many(self, data: bytes) -> bytes:
        address, count = _two_words(data[:4])
        _check(1 <= count <= _WRITE_LIMIT and data[4:5] == bytes([2 * count]), ExceptionCode.ILLEGAL_VALUE)
        _check(len(data) == 5 + 2 * count, ExceptionCode.ILLEGAL_VALUE)
        _check(address + count <= _ADDRESSES, ExceptionCode.ILLEGAL_ADDRESS)
        self.registers.write(address, struct.unpack_from(f">{count}H", data, 5))
        return data[:4]


class ModbusTcpSession:
    """One connection to a server; it does not answer requests for another unit, or invalid bytes."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._received = bytearray()

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answers to completed requests."""
        self._received += data
        answers = bytearray()
        while len(self._received) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._received)
            if protocol != 0 or not 2 <= length <= _LONGEST:
                self._received.clear()  # the start of the next request is unknown
                break
            end = _HEADER.size - 1 + length
            if len(self._received) < end:
                break
            request = bytes(self._received[_HEADER.size : end])
            del self._received[:end]
            if unit == self._server.unit_id:
                answer = self._server.answer(request)
                answers += _HEADER.pack(transaction, 0, len(answer) + 1, unit) + answer
        return bytes(answers)


class ModbusRtuSession:
    """A serial line to a server, or one behind a TCP serial server.

    It does not answer a frame with a wrong checksum or for another unit; an incomplete frame is dropped after 0.05 s of
    silence.
    """

    def __init__(self, server: ModbusServer, now_s: Callable[[], float], *, answer_after_s: float = 0.0) -> None:
        self._server, self._now_s, self._answer_after_s = server, now_s, answer_after_s
        self._received = bytearray()
        self._received_at_s = -math.inf
        self._later: Later | None = None

    def answer_by(self, later: Later) -> None:
        """Set the callback for later answers."""
        self._later = later

    def feed(self, data: bytes) -> bytes:
        """Receive bytes in any portions; return the answer to a completed request."""
        if self._now_s() - self._received_at_s > _FRAME_END_S:
            self._received.clear()
        self._received_at_s = self._now_s()
        self._received += data
        if len(self._received) < _request_bytes(self._received):
            return b""
        frame = bytes(self._received)
        self._received.clear()
        if crc16(frame) != 0 or frame[0] != self._server.unit_id:
            return b""
        answer = frame[:1] + self._server.answer(frame[1:-2])
        answer += crc16(answer).to_bytes(2, "little")
        if self._answer_after_s == 0 or self._later is None:
            return answer
        self._later(self._answer_after_s, lambda: answer)
        return b""


def crc16(data: bytes) -> int:
    """Checksum of a serial frame: polynomial A001 reflected, from FFFF; 0 over a frame including its checksum."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def _request_bytes(received: bytes | bytearray) -> int:
    """Length of the frame with this beginning, as far as known."""
    if len(received) < 2 or received[1] != WRITE_MANY:
        return 8
    return 9 + received[6] if len(received) > 6 else 9


def _two_words(data: bytes) -> tuple[int, int]:
    _check(len(data) == _TWO_WORDS.size, ExceptionCode.ILLEGAL_VALUE)
    first, second = _TWO_WORDS.unpack(data)
    return first, second


def _check(allowed: bool, otherwise: ExceptionCode) -> None:
    if not allowed:
        raise RegisterError(otherwise)
