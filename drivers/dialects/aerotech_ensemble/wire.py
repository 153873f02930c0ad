"""Aerotech Ensemble ASCII lines in both directions, without their line ends.

A command is a line; its answer is one status character, and data. Source: the common behaviour of third-party drivers
(the Tango server tiagocoutinho/aerotech, ESRF's BLISS, EPICS motorAerotech), not a manual of the maker. `PFBK X` and
`PFBK(X)` are the same query; this module sends the first.
"""

from __future__ import annotations

import math
import re
from enum import Enum, IntFlag
from functools import lru_cache
from typing import NamedTuple

from drivers.protocols.texts import decimal, matched

NO_WAIT = "WAIT MODE NOWAIT"  # a move is acknowledged when it is accepted, not when it is finished (BLISS, EPICS)
FINGERPRINT_PARAMETER = (
    "CountsPerUnit"  # EPICS and BLISS address it by number, the Tango server addresses others by name
)


class Outcome(Enum):
    """Status character of an answer."""

    DONE = "%"
    INVALID = "!"
    FAULT = "#"
    TIMEOUT = "$"


class Reply(NamedTuple):
    """An answer: status, and data of a query."""

    outcome: Outcome
    data: str = ""

    def __str__(self) -> str:
        return f"{self.outcome.value}{self.data}"


class AxisStatus(IntFlag):
    """Used bits of AXISSTATUS."""

    ENABLED = 1 << 0
    HOMED = 1 << 1
    IN_POSITION = 1 << 2
    MOVING = 1 << 3
    ACCELERATING = 1 << 4
    DECELERATING = 1 << 5
    HOMING = 1 << 14


class AxisFault(IntFlag):
    """Bits of AXISFAULT; they stay until they are acknowledged."""

    POSITION_ERROR = 1 << 0
    OVER_CURRENT = 1 << 1
    POSITIVE_HARDWARE_LIMIT = 1 << 2
    NEGATIVE_HARDWARE_LIMIT = 1 << 3
    POSITIVE_SOFTWARE_LIMIT = 1 << 4
    NEGATIVE_SOFTWARE_LIMIT = 1 << 5
    AMPLIFIER = 1 << 6
    FEEDBACK = 1 << 7
    VELOCITY_FEEDBACK = 1 << 8
    HALL_SENSOR = 1 << 9
    VELOCITY_COMMAND = 1 << 10
    EMERGENCY_STOP = 1 << 11
    VELOCITY_ERROR = 1 << 12
    EXTERNAL = 1 << 15
    MOTOR_TEMPERATURE = 1 << 17
    AMPLIFIER_TEMPERATURE = 1 << 18
    ENCODER = 1 << 19
    LINK_LOST = 1 << 20
    MARKER = 1 << 23


# Messages of the driver, to be completed by the name of an axis

ENABLE = "ENABLE {}"  # the servo, and energise the motor
ABORT = "ABORT {}"  # decelerate and hold
FEEDBACK_QUERY = "PFBK {}"  # encoder angle, °
STATUS_QUERY = "AXISSTATUS {}"
FAULT_QUERY = "AXISFAULT {}"
FINGERPRINT_QUERY = f"GETPARM({{}}, {FINGERPRINT_PARAMETER})"  # its answer cannot be mistaken for another


def move_absolute(axis: str, angle_deg: float, rate_dps: float) -> str:
    """Command: move to an angle at a rate; other drivers write the rate as F5 or, for axis X alone, as XF5."""
    return f"MOVEABS {axis} {decimal(angle_deg)} F{decimal(rate_dps).removesuffix('.0')}"


def read_reply(line: bytes) -> Reply:
    """Decode an answer; ValueError for an unknown status character."""
    text = line.decode("ascii")
    return Reply(Outcome(text[:1]), text[1:])


_ANGLE = re.compile(r"[+-]?\d+(?:[.,]\d*)?(?:[eE][+-]?\d+)?", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,10}", re.ASCII)


def read_angle(data: str) -> float:
    """Decode an angle, °; ValueError.

    A decimal comma is accepted: controllers on a localised system send one, and in a single number without grouping it
    is unambiguous.
    """
    if not _ANGLE.fullmatch(data) or not math.isfinite(angle_deg := float(data.replace(",", "."))):
        raise ValueError(f"'{data}' is not an angle")
    return angle_deg


def read_status(data: str) -> AxisStatus:
    """Decode the AxisStatus bits of a signed 32-bit number; ValueError."""
    return AxisStatus(_bits(data) & _ALL_STATUS)


def read_fault(data: str) -> AxisFault:
    """Decode the AxisFault bits of a signed 32-bit number, unknown ones too; ValueError."""
    return AxisFault(_bits(data))


_ALL_STATUS = sum(AxisStatus)


def _bits(data: str) -> int:
    if not _INTEGER.fullmatch(data) or not -(1 << 31) <= int(data) < 1 << 32:
        raise ValueError(f"'{data}' is not a 32-bit number")
    return int(data) & 0xFFFF_FFFF


def name_faults(faults: AxisFault) -> str:
    """Names of faults, like "emergency stop, over current"; unknown bits by number."""
    names = [(fault.name or "").lower().replace("_", " ") for fault in AxisFault if fault in faults]
    unknown = int(faults) & ~sum(AxisFault)
    names += [f"bit {bit}" for bit in range(32) if unknown >> bit & 1]
    return ", ".join(names)


# Parsing and messages of the simulator


class Command(NamedTuple):
    """A command as parsed by a controller: word and arguments, in capitals."""

    word: str
    arguments: tuple[str, ...]


class Move(NamedTuple):
    """The arguments of MOVEABS; without a rate the controller uses its default."""

    axis: str
    angle_deg: float
    rate_dps: float | None


_MOVE = re.compile(r"(\w+) ([+-]?[\d.]+)(?: (?:\1)?F ?([\d.]+))?", re.ASCII)


@lru_cache(maxsize=256)
def parse_command(line: bytes) -> Command:
    """Parse a line into word and arguments, in parentheses or after a space; ValueError."""
    words = re.findall(r"[^\s(),]+", line.decode("ascii").upper())
    if not words:
        raise ValueError("an empty line")
    return Command(words[0], tuple(words[1:]))


def parse_move(arguments: tuple[str, ...]) -> Move:
    """Parse the arguments of MOVEABS, like X 90.0 F5; ValueError."""
    match = matched(_MOVE, " ".join(arguments), "not an axis, an angle and a rate")
    return Move(match[1], float(match[2]), None if match[3] is None else float(match[3]))


def render(reply: Reply) -> bytes:
    """Encode an answer with its line end."""
    return f"{reply}\n".encode("ascii")


def signed(bits: int) -> str:
    """Convert 32 bits to the signed number that controllers send."""
    return str(bits - (1 << 32) if bits >> 31 else bits)
