"""Common parts of SCPI instruments: headers, messages, numbers and the error queue; no I/O.

Sources: IEEE 488.2 and SCPI-1999. Drivers decode answers with it, simulators decode messages.
"""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import product
from typing import NamedTuple

from drivers.protocols.texts import matched
from drivers.values import Identity

NOT_A_NUMBER = 9.9e37  # SCPI-1999 7.2.1: 9.9E37 stands for infinity, 9.91E37 for not a number
NO_ERROR = 0

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,10}", re.ASCII)
_ERROR = re.compile(r"""([+-]?\d{1,6})\s*,\s*(?:"((?:[^"]|"")*)"|'([^']*)'|([A-Za-z][^"',;]*))""", re.ASCII)
_EVENT_ERRORS = {  # bit of the event status register, and its class of errors
    5: (-100, "Command error"), 4: (-200, "Execution error"), 3: (-300, "Device-specific error"),
    2: (-400, "Query error"),
}  # fmt: skip
_MNEMONIC = re.compile(r"(\[?[:*]?)([A-Za-z]+)(:?\]?)", re.ASCII)


class ErrorEntry(NamedTuple):
    """One entry of an instrument's error queue; code 0 means that the queue is empty."""

    code: int
    text: str

    def __str__(self) -> str:
        return f'{self.code},"{self.text}"'


class Command(NamedTuple):
    """One command or query of a message: complete header in capitals, from the root, and argument."""

    header: str
    argument: str


def number(text: str) -> float:
    """Decode a finite decimal number; ValueError for anything else, including SCPI's infinity and not-a-number."""
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"'{text}' is not a number")
    value = float(text)
    if not abs(value) < NOT_A_NUMBER:
        raise ValueError(f"{text} stands for overflow or no reading")
    return value


def boolean(text: str) -> bool:
    """Decode the state of a switch, 0 or 1; ValueError for anything else."""
    if text not in ("0", "1"):
        raise ValueError(f"'{text}' is neither 0 nor 1")
    return text == "1"


def integer(text: str) -> int:
    """Decode a register, an integer without a decimal point; ValueError for anything else."""
    if not _INTEGER.fullmatch(text):
        raise ValueError(f"'{text}' is not a whole number")
    return int(text)


def spell(value: float) -> str:
    """Format a number with six significant digits, more than any setting here resolves."""
    return f"{value:.6G}"


def answers(line: bytes, count: int) -> list[str]:
    """Split the answers to `count` queries of one message, which are joined by semicolons; ValueError."""
    found = [part.strip(" ") for part in line.decode("ascii").split(";")]
    if len(found) != count:
        raise ValueError(f"{len(found)} answers to {count} questions")
    return found


def error_entry(line: bytes) -> ErrorEntry:
    """Decode an answer to SYST:ERR?, like `-113,"Undefined header"`; ValueError.

    Variants of the empty queue are `0,"No error"`, `+0,"No error"`, `0,'No error'` and `0,No error`. A number alone is
    rejected, because queries of switches have the same answer.
    """
    match = matched(_ERROR, line.decode("ascii").strip(), "not an entry of an error queue")
    quoted, otherwise = match[2], match[3] or match[4] or ""
    return ErrorEntry(int(match[1]), otherwise.strip() if quoted is None else quoted.replace('""', '"'))


def event_entry(line: bytes) -> ErrorEntry:
    """Decode the first error of an answer to *ESR?, which is mandatory in IEEE 488.2; ValueError."""
    events = integer(line.decode("ascii").strip())
    for bit, (code, kind) in _EVENT_ERRORS.items():
        if events >> bit & 1:
            return ErrorEntry(code, f"{kind}, *ESR? is {events}")
    return ErrorEntry(NO_ERROR, "No error")


def identity(line: bytes) -> Identity:
    """Decode an answer to *IDN?: maker, model, and serial number and firmware, which may be empty; ValueError."""
    fields = [field.strip(" \r") for field in line.decode("ascii").split(",", 3)]
    if len(fields) != 4 or not all(fields[:2]):
        raise ValueError("not maker,model,serial,firmware")
    maker, model, serial, firmware = fields
    return Identity(maker=maker, model=model, serial=serial, firmware=firmware)


@lru_cache(maxsize=256)
def commands(message: str) -> tuple[Command, ...]:
    """Parse the commands of a message, separated by semicolons outside quotes.

    A header without a leading colon continues in the group of the one before it; common commands (`*CLS`) leave the
    group as it is.
    """
    found: list[Command] = []
    group = ""
    for unit in re.findall(r'(?:[^;"]|"[^"]*"?)+', message):
        header, _, argument = unit.strip().partition(" ")
        header = header.upper()
        if not header:
            continue
        if header.lstrip(":").startswith("*"):
            header = header.lstrip(":")
        else:
            header = header.removeprefix(":") if header.startswith(":") else group + header
            group = header[: header.rfind(":") + 1]
        found.append(Command(header, argument.strip()))
    return tuple(found)


@lru_cache(maxsize=256)
def spellings(header: str) -> tuple[str, ...]:
    """Return every spelling, in capitals, of a header in the notation of manuals: `[SOURce:]CURRent:COMPliance`.

    Each word may be in long or short form (its capitals); words in brackets are optional; a `?` makes a query.
    """
    words = (_forms(*match.groups()) for match in _MNEMONIC.finditer(header))
    end = "?" if header.endswith("?") else ""
    return tuple("".join(spelling) + end for spelling in product(*words))


def _forms(before: str, mnemonic: str, after: str) -> tuple[str, ...]:
    short = "".join(letter for letter in mnemonic if letter.isupper())
    forms = dict.fromkeys(f"{before.lstrip('[')}{word}{after.rstrip(']')}" for word in (short, mnemonic.upper()))
    return (*forms, "") if before.startswith("[") else tuple(forms)
