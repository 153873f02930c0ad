"""SIMSERV messages ⇄ values, both directions; no I/O.

Sources: several third-party drivers, two of them based on the maker's manual of 2019. A message is a function number,
the chamber number (always 1) and up to four arguments, separated by the byte B6 and ended by CR. The answer is 1 and
the requested values, or a negative error number alone; it ends with CR LF. The text is ISO 8859-1.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from enum import IntEnum, IntFlag
from typing import Literal, TypeVar

from drivers.kinds.chamber.refusal import Refusal
from drivers.kinds.chamber.tenths import as_stored

T = TypeVar("T")
Reads = Literal["target", "in_force"]

END, ANSWER_END = b"\r", b"\r\n"
SEPARATOR = "\xb6"
DONE = 1
TEMPERATURE = 1  # the first control variable
START = 1  # the digital output that starts and stops

STEPS_PER_C_PER_MIN = 1000  # resolution of gradients here
REFUSALS: Mapping[int, str] = {
    -1: "an empty message",
    -2: "missing chamber number",
    -3: "invalid chamber number",
    -4: "no such chamber",
    -5: "unknown function",
    -6: "too few or wrong arguments",
    -7: "no server",
    -8: "no such item, or it could not be read",
    -9: "not executed",
    -10: "invalid index",
    -11: "nobody is logged in",
    -12: "no permission for the user who is logged in",
    -13: "logged in twice",
}

_NUMBER = re.compile(r"-?\d{1,4}(?:\.\d{1,6})?", re.ASCII)
_WHOLE = re.compile(r"\d{1,5}", re.ASCII)


class Function(IntEnum):
    """Function number of a message."""

    STATUS = 10012
    SET_SET_POINT = 11001
    SET_POINT = 11002
    PROCESS_VALUE = 11004
    LOWEST = 11007
    HIGHEST = 11009
    UNIT = 11023
    GRADIENT_UP = 11066
    SET_GRADIENT_UP = 11068
    GRADIENT_DOWN = 11070
    SET_GRADIENT_DOWN = 11072
    SWITCH = 14001
    SWITCHED = 14003
    MESSAGES = 17002
    MESSAGE_TEXT = 17007
    MESSAGE_ACTIVE = 17009
    CLEAR_ERRORS = 17012
    START_PROGRAM = 19014
    STOP_PROGRAM = 19015
    PROGRAM_STATUS = 19210
    INFO = 99997


class Info(IntEnum):
    """Identification items of a chamber."""

    TYPE = 1
    YEAR = 2
    SERIAL = 3


class Status(IntFlag):
    """Status bits of a chamber."""

    AVAILABLE = 1
    RUNNING = 2
    WARNING = 4
    ERROR = 8


def message(function: Function, *arguments: int | str) -> str:
    """Encode a message without its end."""
    return SEPARATOR.join(map(str, (int(function), 1, *arguments)))


def temperature(value_c: float) -> str:
    """Format a set point."""
    return f"{as_stored(value_c):.1f}"


def gradient(rate_c_per_min: float) -> str:
    """Format a gradient."""
    return f"{round(rate_c_per_min * STEPS_PER_C_PER_MIN) / STEPS_PER_C_PER_MIN:g}"


def unless_refused(read: Callable[[list[str]], T]) -> Callable[[bytes], T | Refusal]:
    """Decode the values of an answer; Refused for a refusal, ValueError if it is neither."""

    def read_line(line: bytes) -> T | Refusal:
        code, *fields = line.decode("latin-1").split(SEPARATOR)
        if code == str(DONE):
            return read(fields)
        if re.fullmatch(r"-\d{1,3}", code, re.ASCII) is None:
            raise ValueError("neither 1 nor a negative number")
        return Refusal(code, REFUSALS.get(int(code), ""))

    return read_line


def nothing(fields: list[str]) -> None:
    """Decode an acknowledgement; further values are ignored."""


def text(fields: list[str]) -> str:
    """Decode one text field."""
    if len(fields) != 1:
        raise ValueError(f"{len(fields)} fields, expected 1")
    return fields[0].strip()


def number(fields: list[str]) -> float:
    """Decode one decimal number."""
    found = text(fields)
    if _NUMBER.fullmatch(found) is None:
        raise ValueError(f"'{found}' is not a number")
    return float(found)


def whole(fields: list[str]) -> int:
    """Decode one integer that is not negative."""
    found = text(fields)
    if _WHOLE.fullmatch(found) is None:
        raise ValueError(f"'{found}' is not a whole number")
    return int(found)


def status(fields: list[str]) -> Status:
    """Decode the status of the chamber."""
    return Status(whole(fields) & sum(Status))
