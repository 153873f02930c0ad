"""Registers of Binder's MB1 and MB2 controllers ⇄ values, both directions.

Addresses are those on the wire, from third-party drivers. A temperature is a float32 in two registers, low word first.
Sources disagree which of two registers of an MB1 is the basic and which the manual set point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from drivers.kinds.chamber.words import COLDEST_C, HOTTEST_C, Words, float32_value, float32_words

Kind = Literal["mb1", "mb2"]
SetPointName = Literal["manual", "basic"]

SMALLEST_C = 1e-6  # a value closer to zero is a float32 with swapped words

# MB1
MODE = 0x1A22
ALARM = 0x123D
DOOR = 0x1007
BASIC, MANUAL = 0x156F, 0x1581

# MB2
LINES = 0x1158
PROGRAM_STOP = 0x114A
IDLE_LINE = 1 << 1  # of the operation lines


class Mode(IntEnum):
    """Control modes of an MB1."""

    IDLE = 0
    PROGRAM = 0x0400
    MANUAL = 0x0800
    BASIC = 0x1000


@dataclass(frozen=True, slots=True)
class Registers:
    """Register addresses of the temperatures of one controller."""

    process_value: int
    set_point_in_force: int
    set_point: int


def registers_of(kind: Kind, name: SetPointName, *, swapped: bool) -> Registers:
    """Register addresses; `swapped` exchanges the basic and the manual set point of an MB1."""
    if kind == "mb2":
        return Registers(0x1004, 0x10B2, 0x114C)
    return Registers(0x11A9, 0x1077, BASIC if (name == "basic") != swapped else MANUAL)


def mode_of(name: SetPointName) -> Mode:
    """Mode in which an MB1 follows a set point."""
    return Mode.BASIC if name == "basic" else Mode.MANUAL


def words(temperature_c: float) -> Words:
    """Encode a temperature into two registers."""
    return float32_words(temperature_c, "low_first")


def value_c(pair: Sequence[int]) -> float:
    """Decode the temperature in two registers; ValueError if it is implausible."""
    found = float32_value(pair, "low_first")
    if not COLDEST_C <= found <= HOTTEST_C or 0 < abs(found) < SMALLEST_C:
        raise ValueError(f"{found:g} °C is no temperature")
    return found
