"""Fixed-length frames ⇄ numbers: number formats, checksums, and detection of frame starts.

Independent of any instrument: a profile defines the fields.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

NumberType = Literal["u8", "i8", "u16", "i16", "u32", "i32", "i64", "f32", "f64"]
ByteOrder = Literal["little", "big"]
ChecksumKind = Literal["sum8", "xor8", "sum16", "crc16", "crc32"]
Raw = int | float
"""Raw number on the wire."""

_CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "i64": "q", "f32": "f", "f64": "d"}
_CHECKSUM_BYTES = {"sum8": 1, "xor8": 1, "sum16": 2, "crc16": 2, "crc32": 4}

_DIGITS = 9  # decimals; the rounding residue of a scale beyond them is dropped


@dataclass(frozen=True, slots=True)
class NumberFormat:
    """Format and place of one number in a frame: a value is its raw number times `scale`, plus `offset`."""

    at: int
    type: NumberType
    byte_order: ByteOrder = "little"
    scale: float = 1.0
    offset: float = 0.0

    @property
    def end(self) -> int:
        """Offset of the next byte."""
        return self.at + struct.calcsize(self._code)

    def raw(self, value: float) -> Raw:
        """Convert a value to wire units, rounded; OverflowError if it does not fit."""
        raw: Raw = (value - self.offset) / self.scale
        try:
            kept: Raw = struct.unpack(self._code, struct.pack(self._code, raw if self._is_float else round(raw)))[0]
        except (struct.error, ValueError, OverflowError) as problem:
            raise OverflowError(f"{value:g} does not fit {self.type}") from problem
        return kept

    def value(self, raw: Raw) -> float:
        """Convert a raw number to a value."""
        return round(raw * self.scale + self.offset, _DIGITS)

    def write(self, frame: bytearray, raw: Raw) -> None:
        """Write a raw number into its place."""
        struct.pack_into(self._code, frame, self.at, raw)

    def read(self, frame: bytes) -> Raw:
        """Read the raw number in its place; ValueError for a float that is not finite or has no finite value."""
        raw: Raw = struct.unpack_from(self._code, frame, self.at)[0]
        if not math.isfinite(raw) or not math.isfinite(raw * self.scale + self.offset):
            raise ValueError(f"{raw} at {self.at}")
        return raw

    @property
    def _is_float(self) -> bool:
        return self.type in ("f32", "f64")

    @property
    def _code(self) -> str:
        return ("<" if self.byte_order == "little" else ">") + _CODES[self.type]


@dataclass(frozen=True, slots=True)
class Checksum:
    """Checksum in the last bytes of a frame, before its trailer.

    It covers the bytes from `first` up to it. Sums are of bytes; crc16 has the parameters of the CRC catalogue
    (reveng), `reflected` meaning input and output; crc32 is that of Ethernet and zip.
    """

    kind: ChecksumKind
    first: int = 0
    byte_order: ByteOrder = "little"
    polynomial: int = 0
    initial: int = 0
    reflected: bool = False
    xor_out: int = 0

    @property
    def count(self) -> int:
        """Number of bytes."""
        return _CHECKSUM_BYTES[self.kind]

    def of(self, data: bytes) -> int:
        """Checksum of bytes."""
        match self.kind:
            case "sum8":
                return sum(data) & 0xFF
            case "sum16":
                return sum(data) & 0xFFFF
            case "xor8":
                found = 0
                for byte in data:
                    found ^= byte
                return found
            case "crc32":
                return zlib.crc32(data)
        return self._crc16(data)

    def written(self, frame: bytes | bytearray, end: int) -> bytes:
        """Checksum of a frame in wire order, whose bytes end at `end`."""
        return self.of(bytes(frame[self.first : end])).to_bytes(self.count, self.byte_order)

    def _crc16(self, data: bytes) -> int:
        table = _crc16_table(self.polynomial, self.reflected)
        if self.reflected:
            crc = _mirrored(self.initial, 16)
            for byte in data:
                crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
        else:
            crc = self.initial
            for byte in data:
                crc = crc << 8 & 0xFFFF ^ table[crc >> 8 ^ byte]
        return crc ^ self.xor_out


@dataclass(frozen=True, slots=True)
class FrameFormat:
    """Format of a frame: `fixed` are constant bytes, each with its place; the others are numbers or 0."""

    name: str
    length: int
    fixed: tuple[tuple[int, bytes], ...]
    checksum: Checksum
    trailer: bytes = b""

    @property
    def checksum_at(self) -> int:
        """Offset of the checksum."""
        return self.length - len(self.trailer) - self.checksum.count

    def build(self, numbers: Iterable[tuple[NumberFormat, Raw]]) -> bytes:
        """Build a frame with these numbers."""
        frame = bytearray(self.length)
        for form, raw in numbers:
            form.write(frame, raw)
        for at, data in self.fixed:
            frame[at : at + len(data)] = data
        end = self.checksum_at
        frame[end:] = self.checksum.written(frame, end) + self.trailer
        return bytes(frame)

    def may_begin(self, received: bytes | bytearray, at: int) -> bool:
        """Return whether the bytes from `at` on, complete or not, have the constant bytes of the frame."""
        return all(
            received[at + place : at + place + len(data)] == data[: max(0, len(received) - at - place)]
            for place, data in self.fixed
        )

    def fits(self, received: bytes | bytearray, at: int) -> bool:
        """Return whether a complete frame with valid checksum and trailer begins at `at`."""
        if len(received) < at + self.length or not self.may_begin(received, at):
            return False
        frame, end = received[at : at + self.length], self.checksum_at
        return bytes(frame[end:]) == self.checksum.written(frame, end) + self.trailer


class Splitter:
    """Finds frames in received bytes, in any portions, with anything in between.

    A frame is accepted only if it is valid as a whole. Other bytes are dropped: `dropped` counts them, and
    `last_dropped` are the last of them.
    """

    def __init__(self, formats: Sequence[FrameFormat]) -> None:
        self._formats = formats
        self._rest = bytearray()
        self.dropped = 0
        self.last_dropped = b""

    @property
    def unfinished(self) -> bool:
        """True if the buffer may hold the beginning of a frame."""
        return bool(self._rest)

    def feed(self, data: bytes) -> list[tuple[FrameFormat, bytes]]:
        """Frames completed by these bytes, in order."""
        self._rest += data
        found = []
        while (frame := self._next()) is not None:
            found.append(frame)
        return found

    def forget(self) -> None:
        """Clear the buffer."""
        self._drop(len(self._rest))

    def _next(self) -> tuple[FrameFormat, bytes] | None:
        begins = len(self._rest)  # start of a possibly incomplete frame
        for at in range(len(self._rest)):
            for form in self._formats:
                if form.fits(self._rest, at):
                    self._drop(at)
                    frame = bytes(self._rest[: form.length])
                    del self._rest[: form.length]
                    return form, frame
                if at < begins and len(self._rest) < at + form.length and form.may_begin(self._rest, at):
                    begins = at
        self._drop(begins)
        return None

    def _drop(self, count: int) -> None:
        if count:
            self.last_dropped = bytes(self._rest[:count])
            self.dropped += count
            del self._rest[:count]


@lru_cache(maxsize=8)
def _crc16_table(polynomial: int, reflected: bool) -> tuple[int, ...]:
    table = []
    for byte in range(256):
        if reflected:
            crc, mirrored = byte, _mirrored(polynomial, 16)
            for _ in range(8):
                crc = crc >> 1 ^ (mirrored if crc & 1 else 0)
        else:
            crc = byte << 8
            for _ in range(8):
                crc = crc << 1 & 0xFFFF ^ (polynomial if crc & 0x8000 else 0)
        table.append(crc)
    return tuple(table)


def _mirrored(value: int, bits: int) -> int:
    return int(f"{value:0{bits}b}"[::-1], 2)
