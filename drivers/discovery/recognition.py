"""How an instrument is known while nobody has said which driver it needs: by questions that change nothing.

A description that has a Recognition takes part in `bench devices scan`. The instruments of one language take each
other's questions without harm; each language is spoken on a connection of its own, and once one is understood, the
others are not tried.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

from drivers.protocols import scpi
from drivers.values import Identity

IDN = b"*IDN?\r\n"  # an instrument that ends lines with either of the two takes the other for an empty one
_ERRORS_AT_MOST = 32
_IDENTITY = re.compile(rb"[\x20-\x7e]{1,200}")
_ENDS = {"crlf": b"\r\n", "cr": b"\r", "lf": b"\n"}
_DO_SOMETHING = ("*TST", "*CAL", "*TRG", "CAL", "TEST", "MEAS", "INIT", "READ", "DIAG")
"""Questions that begin so make an instrument do something before it answers."""

Blocks = Mapping[str, Mapping[str, object]]
"""Blocks of a device entry, as they are written there."""


class NoSuchRegister(ValueError):
    """Somebody answers in Modbus, and refuses."""


class Port(Protocol):
    """A connection to nobody knows whom."""

    unit_id: int
    is_serial_line: bool

    async def ask(self, question: bytes, *, again: bool = False) -> bytes:
        """All that comes back until the line is quiet, b"" when nothing does.

        Sent once, however many drivers want to know, unless `again`.
        """

    async def registers(self, address: int, count: int, function: Literal[3, 4] = 3) -> Sequence[int]:
        """Modbus registers; NoSuchRegister when they are refused, ValueError when the answer is none."""


def scpi_asks(line: str) -> bool:
    """Whether every command of a line only asks: ends with `?` and makes the instrument do nothing first."""
    found = scpi.commands(line)
    return bool(found) and all(
        command.header.endswith("?") and not command.header.startswith(_DO_SOMETHING) for command in found
    )


@dataclass(frozen=True, slots=True)
class Language:
    """What instruments speak.

    `rank` is when it is tried: what has no line end comes after text, which it would garble on a serial line.
    `asks` tells whether a line that a person types only asks; None where nothing in a line tells. Of a `numbered` one
    there may be several instruments on a line.
    """

    name: str
    rank: int = 1
    asks: Callable[[str], bool] | None = None
    numbered: bool = False


SCPI = Language("scpi", 0, scpi_asks)
MODBUS = Language("modbus", 3, numbered=True)


@dataclass(frozen=True, slots=True)
class Found:
    """An instrument that a driver knows: who it is, and what its entry in a bench file must say because of it.

    With `missing` the entry needs something first that only a person has.
    """

    identity: Identity
    blocks: Blocks = field(default_factory=dict)
    missing: str = ""


@dataclass(frozen=True)
class Recognition:
    """How a driver knows its instrument.

    `ask` raises ValueError when it is another. `starter` is what an entry needs besides, with values that are careful
    rather than useful. `lines` are the settings of serial lines as instruments are delivered. What is `generic` is
    asked only where no other driver of the language knows the instrument.
    """

    language: Language
    ask: Callable[[Port], Awaitable[Found]]
    starter: Blocks = field(default_factory=dict)
    lines: tuple[str, ...] = ("baud=9600",)
    generic: bool = False


def text_of(answer: bytes) -> str:
    """One line of printable text without its end; ValueError."""
    line = answer.strip(b"\r\n")
    if _IDENTITY.fullmatch(line) is None:
        raise ValueError("not a line of text")
    return line.decode("ascii")


def answers_idn(
    maker: str, model: str, *, terminators: bool = False, read: Callable[[bytes], Identity] = scpi.identity
) -> Callable[[Port], Awaitable[Found]]:
    """Knows an instrument by the maker and the model in its answer to *IDN?, patterns for all of either.

    With `terminators` the driver has an option of that name, and how the answer ends tells it.
    """

    async def ask(port: Port) -> Found:
        answer = await port.ask(IDN)
        found = read(text_of(answer).encode())
        for pattern, told in ((maker, found.maker), (model, found.model)):
            if re.fullmatch(pattern, told, re.IGNORECASE) is None:
                raise ValueError(f"'{told}' is another")
        ends = next((name for name, end in _ENDS.items() if answer.endswith(end)), "")
        return Found(found, {"options": {"terminator": ends}} if terminators and ends else {})

    return ask


async def forget_errors(port: Port, question: bytes) -> None:
    """Empties an error queue: for what was asked that the instrument does not know."""
    for _ in range(_ERRORS_AT_MOST):
        if scpi.error_entry(text_of(await port.ask(question, again=True)).encode()).code == scpi.NO_ERROR:
            return
