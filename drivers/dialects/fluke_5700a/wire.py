"""Messages of a Fluke 5700A in both directions, and the sequence of commands to a setting.

Sources: the operators manuals of the 5700A/5720A Series II and the 5730A. Headers are Fluke's own, without colons,
beside the common commands of IEEE 488.2; answers as in computer mode. The manuals do not specify further fields of OUT?
(three are decoded here), and how answers to several queries in one message are joined (one query is sent at a time).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal

from drivers.protocols import scpi

Terminator = Literal["cr", "lf", "crlf"]
TERMINATORS: Mapping[Terminator, bytes] = {"cr": b"\r", "lf": b"\n", "crlf": b"\r\n"}

MODELS = ("5700A", "5720A", "5730A")
RANGES_A = (220e-6, 2.2e-3, 22e-3, 220e-3, 2.2)
INPUT_BUFFER_BYTES = 128
NO_FAULT = 0
XON, XOFF = b"\x11", b"\x13"

IDENTITY_QUERY, STATUS_QUERY, OUTPUT_QUERY = b"*IDN?", b"ISR?", b"OUT?"
EXPLAIN_QUERY = "EXPLAIN? {}"  # text of a fault code
EVENTS_QUERY, MINUTES_QUERY, FAULT_QUERY = b"*ESR?", b"ETIME?", b"FAULT?"
REMOTE, OPERATE, STANDBY = "REMOTE", "OPER", "STBY"
LOCK_RANGE, FREE_RANGE = "RANGELCK ON", "RANGELCK OFF"
ZERO = "OUT 0 A, 0 HZ"


class Status(IntFlag):
    """Used bits of the instrument status register."""

    OPERATING = 1 << 0
    BOOST = 1 << 3
    RANGE_LOCKED = 1 << 5
    OFFSET = 1 << 8
    SCALE = 1 << 9
    REMOTE = 1 << 11
    SETTLED = 1 << 12


class Event(IntFlag):
    """Used bits of the event status register."""

    QUERY_ERROR = 1 << 2
    DEVICE_ERROR = 1 << 3
    EXECUTION_ERROR = 1 << 4
    COMMAND_ERROR = 1 << 5
    POWER_ON = 1 << 7


ERRORS = Event.QUERY_ERROR | Event.DEVICE_ERROR | Event.EXECUTION_ERROR | Event.COMMAND_ERROR


@dataclass(frozen=True, slots=True)
class Setting:
    """Wanted setting of the output; `range_locked` None leaves the range unchanged."""

    level_a: float
    output: bool
    range_locked: bool | None = None

    def __str__(self) -> str:
        return f"{self.level_a:g} A, {'operating' if self.output else 'in standby'}"


OFF = Setting(0.0, False)


@dataclass(frozen=True, slots=True)
class State:
    """Settings and status of a calibrator; `level_a` is None if the output is not DC current."""

    status: Status
    level_a: float | None

    @property
    def flowing_a(self) -> float:
        """Output current: 0 in standby."""
        return (self.level_a or 0.0) if Status.OPERATING in self.status else 0.0

    @property
    def settled(self) -> bool:
        """True if it operates, within its specification."""
        return Status.OPERATING | Status.SETTLED in self.status

    def __str__(self) -> str:
        level = "no DC current" if self.level_a is None else f"{self.level_a:g} A"
        doing = "operating" if Status.OPERATING in self.status else "in standby"
        where = "remote" if Status.REMOTE in self.status else "local"
        return f"{level}, {doing}, {where} (ISR {int(self.status)})"


def set_level(level_a: float) -> str:
    """Command: DC current in plain amperes; a calibrator may take MA as mega or milli."""
    return f"OUT {level_a + 0.0:.9G} A, 0 HZ"


def read_integer(line: bytes) -> int:
    """Decode a register, a count or a fault code; ValueError."""
    return scpi.integer(line.decode("ascii").strip(" "))


def read_text(line: bytes) -> str:
    """Decode a string in quotation marks; ValueError."""
    text = line.decode("ascii").strip(" ")
    if len(text) < 2 or text[0] != '"' or text[-1] != '"':
        raise ValueError("not a text in quotation marks")
    return text[1:-1]


def read_status(line: bytes) -> Status:
    """Decode the answer to ISR?; ValueError."""
    return Status(read_integer(line) & sum(Status))


def read_events(line: bytes) -> Event:
    """Decode the answer to *ESR?; ValueError."""
    return Event(read_integer(line) & sum(Event))


def read_output(line: bytes) -> float | None:
    """Decode the answer to OUT? (amplitude, unit, frequency): DC current (A), None for anything else; ValueError."""
    fields = [field.strip(" ") for field in line.decode("ascii").split(",")]
    if len(fields) < 3 or not fields[1].isalpha():
        raise ValueError("not amplitude,unit,frequency")
    amplitude, frequency_hz = scpi.number(fields[0]), scpi.number(fields[2])
    return amplitude if fields[1].upper() == "A" and frequency_hz == 0 else None


def band_a(range_a: float) -> float:
    """Tolerance of a level read back: a millionth of the range."""
    return 1e-6 * range_a


def choosing_range(range_a: float) -> tuple[Setting, Setting]:
    """Settings in standby that select and lock a range: a level beyond the range below, then the lock.

    A calibrator has no command for a range: it selects the smallest one for a level, unless the range is locked.
    """
    level_a = 0.105 * range_a
    return Setting(level_a, False, False), Setting(level_a, False, True)


def next_step(now: State, wanted: Setting, band_a: float) -> str:
    """Next command on the way to a setting, "" when it is reached.

    Control is taken first. The range is locked or freed in standby, the polarity changes through 0 A, the level comes
    before the output operates, and a current goes to 0 A before standby. In standby, OFF leaves other functions alone.
    """
    operating, locked = Status.OPERATING in now.status, Status.RANGE_LOCKED in now.status
    another_range = wanted.range_locked not in (None, locked)
    if Status.REMOTE not in now.status:
        return REMOTE
    if operating and (not wanted.output or another_range or now.level_a is None):
        return ZERO if now.level_a is not None and abs(now.level_a) > band_a else STANDBY
    if another_range:
        return LOCK_RANGE if wanted.range_locked else FREE_RANGE
    if now.level_a is None:
        return "" if wanted == OFF else set_level(wanted.level_a)
    if abs(now.level_a - wanted.level_a) > band_a:
        return ZERO if operating and now.level_a * wanted.level_a < 0 else set_level(wanted.level_a)
    return OPERATE if wanted.output and not operating else ""
