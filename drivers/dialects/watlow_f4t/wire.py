"""Registers of a Watlow F4T (its data map 1) ⇄ values, both directions.

Addresses are those on the wire, zero-based, from the maker's manual and the drivers that chamber makers publish. Every
value has two registers at an even address: a float32 fills both, an enumeration uses the first, and the second is
treated as zero. Which half of a float comes first is a setting of the controller, low by default.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from drivers.kinds.chamber.words import WordOrder, Words, float32_value, float32_words

LOOP_STRIDE = 160
DISPLAY_UNIT, DISPLAY_UNIT_SERIAL = 6730, 14080  # value over TCP, and value over the serial port
CHAMBER_TEMPERATURE = 27586  # analog input 1, float32, independent of the loops


class LoopRegister(IntEnum):
    """Register addresses of control loop 1; those of the next loop are LOOP_STRIDE higher."""

    CONTROL_MODE = 2730
    SET_POINT_MIN = 2774
    SET_POINT_MAX = 2776
    SET_POINT = 2782
    MANUAL_POWER = 2784
    RAMP_ACTION = 2794
    RAMP_SCALE = 2796
    RAMP_RATE = 2798
    POWER_IN_FORCE = 2808
    SET_POINT_IN_FORCE = 2810
    CONTROL_MODE_IN_FORCE = 2814
    PROCESS_VALUE = 2820


class ControlMode(IntEnum):
    """Control mode of a loop: the source of its output power."""

    AUTO = 10
    MANUAL = 54
    OFF = 62


class RampAction(IntEnum):
    """Condition under which the active set point ramps instead of jumping."""

    BOTH = 13
    OFF = 62
    SET_POINT = 85
    STARTUP = 88


class RampScale(IntEnum):
    """Time unit of a ramp rate."""

    HOURS = 39
    MINUTES = 57


class DisplayUnit(IntEnum):
    """Unit of every temperature on the wire."""

    CELSIUS = 15
    FAHRENHEIT = 30


BLOCK_FIRST = LoopRegister.SET_POINT_IN_FORCE
BLOCK_COUNT = LoopRegister.PROCESS_VALUE + 2 - BLOCK_FIRST


class LoopBlock(NamedTuple):
    """Decoded BLOCK_COUNT registers from BLOCK_FIRST; `mode` is an integer, because ControlMode may be incomplete."""

    set_point_in_force: float
    mode: int
    process_value: float


class LoopFormat(NamedTuple):
    """Format of one control loop of one controller: loop number, from 1, and word order of floats."""

    loop: int = 1
    word_order: WordOrder = "low_first"

    def address(self, register: LoopRegister) -> int:
        """Address of a register in this loop."""
        return register + LOOP_STRIDE * (self.loop - 1)

    def words(self, value: float) -> Words:
        """Encode a float32 into two registers; OverflowError if it does not fit."""
        return float32_words(value, self.word_order)

    def value(self, words: Sequence[int]) -> float:
        """Decode the float32 in two registers; ValueError unless it is finite."""
        return float32_value(words, self.word_order)

    def block(self, words: Sequence[int]) -> LoopBlock:
        """Decode the registers from BLOCK_FIRST; ValueError as for `value`."""
        mode = LoopRegister.CONTROL_MODE_IN_FORCE - BLOCK_FIRST
        return LoopBlock(self.value(words[:2]), words[mode], self.value(words[-2:]))


_MODE_NAMES = {int(mode): mode.name.lower() for mode in ControlMode}


def mode_name(mode: int) -> str:
    """Name of a control mode on the controller's display."""
    return _MODE_NAMES.get(mode) or f"unknown ({mode})"
