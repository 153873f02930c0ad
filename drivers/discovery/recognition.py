"""Recognition of an instrument before its driver is known, by queries that change nothing.

A description that has a Recognition takes part in `bench devices scan`. The queries of one language are harmless to all
its instruments; each language is tried on a connection of its own, and once one is understood, the others are not
tried.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

from drivers.protocols import scpi
from drivers.values import Identity

IDN = b"*IDN?\r\n"  # an instrument that ends lines with one of the two takes the other for an empty line
_MAX_ERRORS = 32
_IDENTITY = re.compile(rb"[\x20-\x7e]{1,200}")
_ENDS = {"crlf": b"\r\n", "cr": b"\r", "lf": b"\n"}
_DO_SOMETHING = ("*TST", "*CAL", "*TRG", "CAL", "TEST", "MEAS", "INIT", "READ", "DIAG")
"""Queries with these beginnings make an instrument act before it answers."""

Blocks = Mapping[str, Mapping[str, object]]
"""Blocks of a device entry, as in the bench file."""


class NoSuchRegister(ValueError):
    """A Modbus exception: there is an instrument, but not this register."""


class Port(Protocol):
    """A connection to an unknown instrument."""

    unit_id: int
    is_serial_line: bool

    async def query(self, question: bytes, *, again: bool = False) -> bytes:
        """Send a query; return the answer up to a silence of the line, b"" if there is none.

        The answer is cached for all drivers; `again` repeats the query.
        """

    async def registers(self, address: int, count: int, function: Literal[3, 4] = 3) -> Sequence[int]:
        """Read Modbus registers; raises NoSuchRegister for an exception, ValueError for an invalid answer."""


def is_scpi_query(line: str) -> bool:
    """Return whether every command of a line is a query that has no effect on the instrument."""
    found = scpi.commands(line)
    return bool(found) and all(
        command.header.endswith("?") and not command.header.startswith(_DO_SOMETHING) for command in found
    )


@dataclass(frozen=True, slots=True)
class Language:
    """Command language of instruments.

    `rank` is the order of attempts: protocols without line ends come after text, which they would corrupt on a serial
    line. `is_query` returns whether a typed line is only a query; None if that cannot be seen from a line. A `numbered`
    language allows several instruments on a line.
    """

    name: str
    rank: int = 1
    is_query: Callable[[str], bool] | None = None
    numbered: bool = False


SCPI = Language("scpi", 0, is_scpi_query)
MODBUS = Language("modbus", 3, numbered=True)


@dataclass(frozen=True, slots=True)
class Found:
    """An instrument recognised by a driver: identity, and the keys of its bench file entry that follow from it.

    `missing` names what the operator has to add to the entry.
    """

    identity: Identity
    blocks: Blocks = field(default_factory=dict)
    missing: str = ""


@dataclass(frozen=True)
class Recognition:
    """Recognition of an instrument by its driver.

    `recognise` raises ValueError if it is another instrument. `starter` holds the other required keys of an entry, with
    conservative values. `lines` are the serial line settings at delivery. A `generic` recognition is tried only after
    all others of the language.
    """

    language: Language
    recognise: Callable[[Port], Awaitable[Found]]
    starter: Blocks = field(default_factory=dict)
    lines: tuple[str, ...] = ("baud=9600",)
    generic: bool = False


def text_of(answer: bytes) -> str:
    """Decode one line of printable text without its end; ValueError."""
    line = answer.strip(b"\r\n")
    if _IDENTITY.fullmatch(line) is None:
        raise ValueError("not a line of text")
    return line.decode("ascii")


def answers_idn(
    maker: str, model: str, *, terminators: bool = False, read: Callable[[bytes], Identity] = scpi.identity
) -> Callable[[Port], Awaitable[Found]]:
    """Recognition by maker and model in the answer to *IDN?, given as patterns.

    With `terminators` the driver has an option `terminator`, whose value follows from the end of the answer.
    """

    async def recognise(port: Port) -> Found:
        answer = await port.query(IDN)
        found = read(text_of(answer).encode())
        for pattern, reported in ((maker, found.maker), (model, found.model)):
            if re.fullmatch(pattern, reported, re.IGNORECASE) is None:
                raise ValueError(f"'{reported}' is another")
        ends = next((name for name, end in _ENDS.items() if answer.endswith(end)), "")
        return Found(found, {"options": {"terminator": ends}} if terminators and ends else {})

    return recognise


async def clear_errors(port: Port, question: bytes) -> None:
    """Clear the error queue of errors caused by unknown queries."""
    for _ in range(_MAX_ERRORS):
        if scpi.error_entry(text_of(await port.query(question, again=True)).encode()).code == scpi.NO_ERROR:
            return
