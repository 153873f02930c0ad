"""Frames of a CTS chamber ⇄ values, both directions; no I/O.

Source: two third-party drivers. A frame is STX, the address, the text with bit 7 of every byte set, the XOR of all of
that with bit 7 set, and ETX: `A0` to address 1 is 02 81 c1 b0 f0 03. A query is a capital letter, and its answer begins
with it; a setting is a small letter, and its answer is that letter. Temperatures are in °C with one decimal, rates in
°C/min.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Literal, TypeVar

from drivers.kinds.chamber.tenths import as_stored
from drivers.protocols.texts import matched

T = TypeVar("T")
RampChannel = Literal[0, 1]

STX, ETX, HIGH_BIT = 0x02, 0x03, 0x80
ADDRESSES = range(1, 33)

TEMPERATURE_QUERY, STATUS_QUERY, VERSIONS_QUERY = "A0", "S", "C"
START, RESUME = "s1 1", "s3 1"
COLDEST_C, HOTTEST_C = -99.9, 999.9  # range of set points in the format of the protocol
STEPS_PER_C_PER_MIN = 10
FULL_SPEED_C_PER_MIN = 999.9  # no ramp

_TEMPERATURES = re.compile(r"A0 (\d{3}\.\d|-\d{2}\.\d) (\d{3}\.\d|-\d{2}\.\d)", re.ASCII)
_RAMP = re.compile(r"R([01]) ([01])([01]) (\d{1,4}\.\d{1,2}) (\d{1,4}\.\d{1,2}) (-?\d{1,4}\.\d{1,2})", re.ASCII)
_STATUS = re.compile(r"S([01])([01])([01])[01]{5}(.)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Temperatures:
    """Answer to A0, °C."""

    process_value_c: float
    set_point_c: float


@dataclass(frozen=True, slots=True)
class Ramp:
    """Answer to R: ramping enabled or not, rates up and down, °C/min, and target, °C."""

    active: bool
    up_c_per_min: float
    down_c_per_min: float
    target_c: float


@dataclass(frozen=True, slots=True)
class Status:
    """Answer to S; `error` is the error number as one character, "" without an error."""

    running: bool
    paused: bool
    error: str


def frame(address: int, text: bytes) -> bytes:
    """Encode a text as a frame."""
    body = bytes([HIGH_BIT | address, *(HIGH_BIT | byte for byte in text)])
    return bytes([STX, *body, HIGH_BIT | reduce(xor, body), ETX])


def text_of(address: int, received: bytes) -> str:
    """Decode the text of a frame without its ETX; ValueError for anything but a complete frame of this address."""
    if len(received) < 4 or received[0] != STX:
        raise ValueError("not a frame")
    *body, checksum = received[1:]
    if min(body) < HIGH_BIT or checksum != HIGH_BIT | reduce(xor, body):
        raise ValueError("the checksum is wrong")
    if body[0] != HIGH_BIT | address:
        raise ValueError(f"from address {body[0] & ~HIGH_BIT}")
    return bytes(byte & ~HIGH_BIT for byte in body[1:]).decode("ascii")


def of_address(address: int, read: Callable[[str], T]) -> Callable[[bytes], T]:
    """Decode a frame of this address."""
    return lambda received: read(text_of(address, received))


def set_point(temperature_c: float) -> str:
    """Command: set point."""
    return f"a0 {as_stored(temperature_c):05.1f}"


def ramp_rates(channel: RampChannel, rate_c_per_min: float) -> tuple[str, str]:
    """Commands: rates up and down."""
    return f"u{channel} {rate_c_per_min:05.1f}", f"d{channel} {rate_c_per_min:05.1f}"


def can_be_set(rate_c_per_min: float) -> bool:
    """Return whether a rate is a multiple of 0.1 °C/min, as can be sent."""
    return abs(rate_c_per_min * STEPS_PER_C_PER_MIN - round(rate_c_per_min * STEPS_PER_C_PER_MIN)) < 1e-9


def read_temperatures(text: str) -> Temperatures:
    """Decode `A0 023.5 -40.0`."""
    return Temperatures(*map(float, matched(_TEMPERATURES, text, "not two temperatures").groups()))


def read_ramp(text: str) -> Ramp:
    """Decode `R1 11 0001.00 0001.00 -40.00`: active, running, up, down, target."""
    _, active, _, up, down, target = matched(_RAMP, text, "not a ramp").groups()
    return Ramp(active == "1", float(up), float(down), float(target))


def read_status(text: str) -> Status:
    """Decode `S101000000`: running, error, not paused, five unused digits, error number."""
    running, error, not_paused, number = matched(_STATUS, text, "not a status").groups()
    return Status(running == "1", not_paused == "0", number if error == "1" else "")


def read_versions(text: str) -> str:
    """Decode `C1.23;4.56;1234;`: versions of PLC and controller, number of the PLC; kept as text."""
    if not text.startswith(VERSIONS_QUERY) or not (found := text[1:].strip("; ")):
        raise ValueError("not versions")
    return found


def read_done(command: str) -> Callable[[str], bool]:
    """Decode the acknowledgement of a setting: its letter, and possibly a number."""

    def read(text: str) -> bool:
        if text[:1] != command[0]:
            raise ValueError(f"not {command[0]}")
        return True

    return read
