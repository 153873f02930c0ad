"""Modbus requests and answers as bytes, over TCP and over a serial line; the only importer of pymodbus.

pymodbus encodes requests, computes the checksum and decodes the content of frames. Frame limits are detected here,
strictly: surplus bytes, or a length that does not fit the function, are an error and never skipped.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Sequence
from typing import Literal, Protocol

from pymodbus.framer.rtu import FramerRTU
from pymodbus.framer.socket import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what it logs is raised here

Pdu = ModbusPDU
Framing = Literal["tcp", "rtu"]
ReadFunction = Literal[3, 4]

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY, REFUSED = 3, 4, 6, 16, 0x80
_HEADER = struct.Struct(">HHH")  # transaction, protocol, length of the rest: before the unit over TCP
_HEADER_BYTES, _CHECKSUM_BYTES = _HEADER.size, 2  # the checksum ends a frame on a serial line
_LONGEST_BYTES = 254  # the unit and 253 bytes of function and data
_DECODER = DecodePDU(is_server=False)
_RTU, _TCP = FramerRTU(_DECODER), FramerSocket(_DECODER)


class Frames(Protocol):
    """Frames of one connection to one unit."""

    def request(self, pdu: Pdu) -> bytes:
        """Encode the next request."""

    def answer(self, received: bytearray) -> Pdu | None:
        """Decode the answer to the last request; None until it is complete.

        Raises ValueError for bytes that cannot be an answer to it.
        """


def read_request(address: int, count: int, function: ReadFunction) -> Pdu:
    """Request to read `count` holding registers (function 3) or input registers (4) from the wire address `address`."""
    if function == READ_INPUT:
        return ReadInputRegistersRequest(address=address, count=count)
    return ReadHoldingRegistersRequest(address=address, count=count)


def write_request(address: int, words: Sequence[int], *, many: bool) -> Pdu:
    """Request to write registers from `address`: one by function 6 unless `many`, several by function 16."""
    if len(words) == 1 and not many:
        return WriteSingleRegisterRequest(address=address, registers=words)
    return WriteMultipleRegistersRequest(address=address, registers=words)


def frames_of(framing: Framing, unit_id: int) -> Frames:
    """Frames for a new connection."""
    return TcpFrames(unit_id) if framing == "tcp" else RtuFrames(unit_id)


class TcpFrames:
    """Frames with a transaction number in the header, by which a late answer is recognised and dropped."""

    def __init__(self, unit_id: int) -> None:
        self._unit_id, self._number, self._function = unit_id, 0, 0

    def request(self, pdu: Pdu) -> bytes:
        """Encode the next request."""
        self._number = self._number % 0xFFFF + 1
        self._function = pdu.function_code
        pdu.dev_id, pdu.transaction_id = self._unit_id, self._number
        return _TCP.buildFrame(pdu)

    def answer(self, received: bytearray) -> Pdu | None:
        """Decode the answer to the last request; one with another number, or of another unit, is dropped."""
        while len(received) > _HEADER_BYTES:
            number, protocol, length = _HEADER.unpack_from(received)
            if protocol != 0 or not 2 <= length <= _LONGEST_BYTES:
                received.clear()  # the start of the next frame is unknown
                return None
            if len(received) < _HEADER_BYTES + length:
                return None
            unit_id, body = received[_HEADER_BYTES], bytes(received[_HEADER_BYTES + 1 : _HEADER_BYTES + length])
            del received[: _HEADER_BYTES + length]
            if number in (0, self._number) and unit_id == self._unit_id:
                if number == 0:
                    raise ValueError("an answer without a number")
                return _decoded(body, self._function)
        return None


class RtuFrames:
    """Frames with a checksum and no number: all bytes after a request must be its answer."""

    def __init__(self, unit_id: int) -> None:
        self._unit_id, self._function = unit_id, 0

    def request(self, pdu: Pdu) -> bytes:
        """Encode the next request."""
        self._function = pdu.function_code
        pdu.dev_id = self._unit_id
        return _RTU.buildFrame(pdu)

    def answer(self, received: bytearray) -> Pdu | None:
        """Decode the answer to the last request; its checksum must be valid and nothing may follow it."""
        if len(received) < 3:
            return None
        unit_id, function, first = received[:3]
        if unit_id != self._unit_id:
            raise ValueError(f"from unit {unit_id} instead of {self._unit_id}")
        length = 1 + _body_bytes(function, first, self._function) + _CHECKSUM_BYTES
        if len(received) < length:
            return None
        frame = bytes(received)
        received.clear()
        checksum = int.from_bytes(frame[length - _CHECKSUM_BYTES : length], "big")
        if not FramerRTU.check_CRC(frame[: length - _CHECKSUM_BYTES], checksum):
            raise ValueError("wrong checksum")
        if len(frame) > length:
            raise ValueError("more than one frame")
        return _decoded(frame[1 : length - _CHECKSUM_BYTES], self._function)


def _body_bytes(function: int, first: int, asked: int) -> int:
    """Length of function code and data of an answer; `first` is the first byte after the function code."""
    if function & ~REFUSED != asked:
        raise ValueError(f"function {function} instead of {asked}")
    if function & REFUSED:
        return 2
    return 2 + first if asked in (READ_HOLDING, READ_INPUT) else 5


def _decoded(body: bytes, asked: int) -> Pdu:
    """Decode an answer; ValueError unless its length fits the function."""
    if len(body) < 2 or len(body) != _body_bytes(body[0], body[1], asked):
        raise ValueError(f"{len(body)} bytes, which function {asked} does not answer")
    answer = _DECODER.decode(body)
    if answer is None:
        raise ValueError("registers in halves")
    return answer
