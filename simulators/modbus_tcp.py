"""The server side of Modbus TCP: requests out of a stream of bytes, answers of registers or exceptions.

Frames are those of the Modbus application protocol: transaction (2 bytes), protocol 0 (2), length of the rest (2),
unit (1), function (1), data. Functions 03, 06 and 16 are served, as the controllers of thermal chambers do.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol

_HEADER = struct.Struct(">HHHB")  # transaction, protocol, length of the rest, unit
_TWO_WORDS = struct.Struct(">HH")
_LONGEST = 254  # the unit and 253 bytes of function and data
_READ_LIMIT, _WRITE_LIMIT = 125, 123  # registers in one request
_ADDRESSES = 0x10000

READ, WRITE_ONE, WRITE_MANY = 3, 6, 16


class ExceptionCode(IntEnum):
    """Why a request is refused."""

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
    """What is behind the server."""

    def read(self, address: int, count: int) -> Sequence[int]:
        """`count` words from `address`; raises RegisterError."""

    def write(self, address: int, words: Sequence[int]) -> None:
        """Takes words from `address` on, all or none; raises RegisterError."""


class ModbusTcpSession:
    """One connection to a server; it says nothing to requests for another unit, or to bytes that are no request."""

    def __init__(self, registers: Registers, unit_id: int) -> None:
        self._registers, self._unit_id = registers, unit_id
        self._received = bytearray()

    def feed(self, data: bytes) -> bytes:
        """Takes bytes in any portions; the answers to the requests that are whole now."""
        self._received += data
        answers = bytearray()
        while len(self._received) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._received)
            if protocol != 0 or not 2 <= length <= _LONGEST:
                self._received.clear()  # where the next request would begin is unknown
                break
            end = _HEADER.size - 1 + length
            if len(self._received) < end:
                break
            request = bytes(self._received[_HEADER.size : end])
            del self._received[:end]
            if unit == self._unit_id:
                answer = self._answer(request[0], request[1:])
                answers += _HEADER.pack(transaction, 0, len(answer) + 1, unit) + answer
        return bytes(answers)

    def _answer(self, function: int, data: bytes) -> bytes:
        try:
            if function == READ:
                return bytes([function]) + self._read(data)
            if function == WRITE_ONE:
                return bytes([function]) + self._write_one(data)
            if function == WRITE_MANY:
                return bytes([function]) + self._write_many(data)
            raise RegisterError(ExceptionCode.ILLEGAL_FUNCTION)
        except RegisterError as refusal:
            return bytes([function | 0x80, refusal.code])

    def _read(self, data: bytes) -> bytes:
        address, count = _two_words(data)
        _check(1 <= count <= _READ_LIMIT, ExceptionCode.ILLEGAL_VALUE)
        _check(address + count <= _ADDRESSES, ExceptionCode.ILLEGAL_ADDRESS)
        words = self._registers.read(address, count)
        return struct.pack(f">B{count}H", 2 * count, *words)

    def _write_one(self, data: bytes) -> bytes:
        address, word = _two_words(data)
        self._registers.write(address, (word,))
        return data

    def _write_many(self, data: bytes) -> bytes:
        address, count = _two_words(data[:4])
        _check(1 <= count <= _WRITE_LIMIT and data[4:5] == bytes([2 * count]), ExceptionCode.ILLEGAL_VALUE)
        _check(len(data) == 5 + 2 * count, ExceptionCode.ILLEGAL_VALUE)
        _check(address + count <= _ADDRESSES, ExceptionCode.ILLEGAL_ADDRESS)
        self._registers.write(address, struct.unpack_from(f">{count}H", data, 5))
        return data[:4]


def _two_words(data: bytes) -> tuple[int, int]:
    _check(len(data) == _TWO_WORDS.size, ExceptionCode.ILLEGAL_VALUE)
    first, second = _TWO_WORDS.unpack(data)
    return first, second


def _check(allowed: bool, otherwise: ExceptionCode) -> None:
    if not allowed:
        raise RegisterError(otherwise)
