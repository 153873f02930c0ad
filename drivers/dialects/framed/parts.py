"""Parts of the frames of a profile: constants, numbers with units, codes and bits."""

from __future__ import annotations

import re
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from drivers.dialects.framed.wire import ByteOrder, Checksum, ChecksumKind, NumberFormat, NumberType
from drivers.schema.fields import NOT_EMPTY, Flag, InUnit, StrictModel, WholeNumber
from drivers.schema.wording import expected, telling

_BYTES = re.compile("[0-9A-Fa-f]{2}( [0-9A-Fa-f]{2})*")
_WORD = re.compile("0[xX][0-9A-Fa-f]{1,4}")


def _bytes(raw: object) -> bytes:
    if isinstance(raw, bytes):
        return raw
    if isinstance(raw, str) and _BYTES.fullmatch(raw):
        return bytes.fromhex(raw)
    hint = "; put it in quotes" if isinstance(raw, (int, float)) and not isinstance(raw, bool) else ""
    raise expected(f"bytes in hexadecimal, like 'AA 55'{hint}", raw)


def _word(raw: object) -> int:
    number = int(raw, 16) if isinstance(raw, str) and _WORD.fullmatch(raw) else raw
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number <= 0xFFFF:
        raise expected("16 bits, 0 to 65535 or 0x0000 to 0xFFFF", raw)
    return number


HexBytes = Annotated[
    bytes, BeforeValidator(_bytes), WithJsonSchema({"type": "string", "pattern": f"^{_BYTES.pattern}$"})
]
Word = Annotated[
    int,
    BeforeValidator(_word),
    WithJsonSchema({
        "anyOf": [
            {"type": "integer", "minimum": 0, "maximum": 0xFFFF},
            {"type": "string", "pattern": f"^{_WORD.pattern}$"},
        ]
    }),
]  # fmt: skip
CountType = Literal["u8", "u16", "u32"]
Offset = Annotated[WholeNumber, Field(ge=0, le=255)]


class LineSettings(StrictModel):
    """Settings of a serial line, with the keys of its address."""

    baud: Annotated[WholeNumber, Field(ge=300, le=4_000_000)] | None = Field(None, description="bit rate")
    bytesize: Literal[7, 8] = Field(8, description="data bits of a byte")
    parity: Literal["N", "E", "O"] = Field("N", description="none, even or odd")
    stopbits: Literal[1, 2] = Field(1, description="at the end of a byte")

    @property
    def bits_per_byte(self) -> int:
        """Number of bits per byte on the line."""
        return 1 + self.bytesize + (self.parity != "N") + self.stopbits

    def options(self) -> dict[str, str]:
        """Options of an address."""
        return {key: str(value) for key, value in self.model_dump(exclude_none=True).items()}


class ChecksumSettings(StrictModel):
    """The checksum of every frame, at its end, before the trailer."""

    kind: ChecksumKind = Field(description="algorithm")
    from_: Offset = Field(0, alias="from", description="first byte covered; the last is the one before the checksum")
    byte_order: ByteOrder | None = Field(None, description="if different from that of the profile")
    polynomial: Word | None = Field(None, description="polynomial of crc16, such as 0x1021")
    initial: Word = Field(0, description="initial value of crc16, such as 0xFFFF")
    reflected: Flag = Field(False, description="of crc16: least significant bit of a byte first")
    xor_out: Word = Field(0, description="of crc16: final XOR value")

    @model_validator(mode="after")
    def _parameters_of_crc16(self) -> Self:
        given = self.model_fields_set & {"polynomial", "initial", "reflected", "xor_out"}
        if self.kind != "crc16" and given:
            raise telling(f"{', '.join(sorted(given))}: only crc16 has this, not {self.kind}")
        if self.kind == "crc16" and self.polynomial is None:
            raise telling("crc16 needs its polynomial")
        return self

    def of(self, order: ByteOrder) -> Checksum:
        """Checksum for the codec."""
        return Checksum(
            self.kind, self.from_, self.byte_order or order, self.polynomial or 0, self.initial, self.reflected,
            self.xor_out,
        )  # fmt: skip


class Place(StrictModel):
    """A field at a place of a frame, whose first byte is 0."""

    at: Offset = Field(description="first byte")

    @property
    def count(self) -> int:
        """Number of bytes."""
        return 1

    @property
    def shares(self) -> bool:
        """True if other fields may share the byte."""
        return False


class Constant(Place):
    """Constant bytes."""

    bytes: HexBytes = Field(description="in hexadecimal")

    @property
    def count(self) -> int:
        """Number of bytes."""
        return len(self.bytes)


class Count(Place):
    """An integer without a unit."""

    type: CountType = Field("u8", description="number format")
    byte_order: ByteOrder | None = Field(None, description="if different from that of the profile")

    @property
    def count(self) -> int:
        """Number of bytes."""
        return self.form("little").end - self.at

    def form(self, order: ByteOrder) -> NumberFormat:
        """Number format for the codec."""
        return NumberFormat(self.at, self.type, self.byte_order or order)


class Code(Count):
    """A code of the servo mode; an unlisted one is another mode."""

    off: WholeNumber = Field(description="it holds")
    position: WholeNumber = Field(description="an angle")
    rate: WholeNumber | None = Field(None, description="a rate")
    sine: WholeNumber | None = Field(None, description="a sine")

    @model_validator(mode="after")
    def _numbers_mean_one_thing(self) -> Self:
        listed = [each for each in (self.off, self.position, self.rate, self.sine) if each is not None]
        if len(set(listed)) < len(listed):
            raise telling("one number is used for two modes")
        return self


class Number(Place):
    """A number with a unit: the raw value times `scale`, plus `offset`."""

    type: NumberType = Field(description="number format: unsigned, signed or floating, and bits")
    byte_order: ByteOrder | None = Field(None, description="if different from that of the profile")
    scale: float = Field(description="value of one count")
    offset: float = Field(0.0, description="what 0 means")

    @model_validator(mode="after")
    def _scale_is_not_zero(self) -> Self:
        if self.scale == 0:
            raise telling("scale is 0")
        return self

    @property
    def count(self) -> int:
        """Number of bytes."""
        return self.form("little").end - self.at

    def form(self, order: ByteOrder) -> NumberFormat:
        """Number format for the codec."""
        return NumberFormat(self.at, self.type, self.byte_order or order, self.scale, self.offset)


class AngleNumber(Number):
    """An angle."""

    scale: Annotated[float, InUnit("°")] = Field(description="value of one count; negative for the opposite direction")
    offset: Annotated[float, InUnit("°")] = Field(0.0, description="the angle at raw value 0")


class AmplitudeNumber(Number):
    """The amplitude of a sine."""

    scale: Annotated[float, InUnit("°", above=0)] = Field(description="value of one count")
    offset: Annotated[float, InUnit("°")] = Field(0.0, description="the amplitude at raw value 0")


class RateNumber(Number):
    """A rate."""

    scale: Annotated[float, InUnit("°/s")] = Field(
        description="value of one count; negative for the opposite direction"
    )
    offset: Annotated[float, InUnit("°/s")] = Field(0.0, description="the rate at raw value 0")


class AccelerationNumber(Number):
    """An acceleration."""

    scale: Annotated[float, InUnit("°/s²", above=0)] = Field(description="value of one count")
    offset: Annotated[float, InUnit("°/s²")] = Field(0.0, description="the acceleration at raw value 0")


class FrequencyNumber(Number):
    """A frequency."""

    scale: Annotated[float, InUnit("Hz", above=0)] = Field(description="value of one count")
    offset: Annotated[float, InUnit("Hz")] = Field(0.0, description="the frequency at raw value 0")


class Bit(Place):
    """One bit of a state."""

    bit: Annotated[WholeNumber, Field(ge=0, le=7)] = Field(description="bit of the byte; 0 is the lowest")
    is_: Literal[0, 1] = Field(1, alias="is", description="its value while the state is active")

    @property
    def shares(self) -> bool:
        """True: bits share a byte."""
        return True

    def read(self, frame: bytes) -> bool:
        """Return whether the state bit is active."""
        return frame[self.at] >> self.bit & 1 == self.is_


class Fault(Place):
    """A bit that reports a fault, or a byte with its code."""

    means: Annotated[str, Field(min_length=1, max_length=80)] = Field(
        description="name of the fault, such as 'overspeed'"
    )
    bit: Annotated[WholeNumber, Field(ge=0, le=7)] | None = Field(
        None, description="bit of the byte, 1 during the fault; without it, the whole byte is a code"
    )
    quiet: Annotated[list[Annotated[WholeNumber, Field(ge=0, le=255)]], NOT_EMPTY] = Field(
        [0], description="codes that are no fault"
    )

    @property
    def shares(self) -> bool:
        """True for a bit: bits share a byte."""
        return self.bit is not None

    def text(self, frame: bytes) -> str:
        """Description of the fault; "" while there is none."""
        byte = frame[self.at]
        if self.bit is not None:
            return self.means if byte >> self.bit & 1 else ""
        return "" if byte in self.quiet else f"{self.means} ({byte})"
