"""Keithley 6220 headers and answers, and the sequence of commands to a setting.

Sources: the reference manual and the specification of the 6220/6221.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntFlag
from functools import lru_cache
from typing import Literal, NamedTuple

from drivers.kinds.source.setting import Commands, Setting
from drivers.protocols import scpi

Terminator = Literal["cr", "lf", "crlf"]
TERMINATORS: Mapping[Terminator, bytes] = {"cr": b"\r", "lf": b"\n", "crlf": b"\r\n"}

# Headers for the simulator
LEVEL = "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]"
RANGE = "[SOURce:]CURRent:RANGe"
AUTO_RANGE = "[SOURce:]CURRent:RANGe:AUTO"
COMPLIANCE = "[SOURce:]CURRent:COMPliance"
OUTPUT = "OUTPut[:STATe]"
CONDITION = "STATus:MEASurement:CONDition"

STATE_QUERY = b":SOUR:CURR:RANG?;:SOUR:CURR:RANG:AUTO?;:SOUR:CURR?;:SOUR:CURR:COMP?;:OUTP?;:STAT:MEAS:COND?"
COMMANDS = Commands(
    range=":SOUR:CURR:RANG", compliance=":SOUR:CURR:COMP", level=":SOUR:CURR", on=":OUTP ON", off=":OUTP OFF"
)

RANGES_A = (2e-9, 20e-9, 200e-9, 2e-6, 20e-6, 200e-6, 2e-3, 20e-3, 100e-3)
OVER_RANGE = 1.05  # a range can be set to 5 % more than its name
COMPLIANCE_MIN_V, COMPLIANCE_MAX_V, COMPLIANCE_STEP_V = 0.1, 105.0, 0.01


class Condition(IntFlag):
    """Used bits of the measurement condition register."""

    INTERLOCK = 1 << 1
    OVER_TEMPERATURE = 1 << 2
    COMPLIANCE = 1 << 3


class State(NamedTuple):
    """Settings and condition of a source."""

    setting: Setting
    auto_range: bool
    condition: Condition


def step_a(range_a: float) -> float:
    """Resolution of a level in a range: by the specification 100 nA at 2 mA, 1 µA at 20 mA, 10 µA at 100 mA."""
    return range_a * (1e-4 if range_a == RANGES_A[-1] else 5e-5)


_CONDITIONS = sum(Condition)


@lru_cache(maxsize=64)  # a source that is left alone gives the same answer
def read_state(line: bytes) -> State:
    """Decode the answer to STATE_QUERY; ValueError."""
    range_, auto, level, compliance, output, condition = scpi.answers(line, 6)
    setting = Setting(scpi.number(range_), scpi.number(level), scpi.number(compliance), scpi.boolean(output))
    return State(setting, scpi.boolean(auto), Condition(scpi.integer(condition) & _CONDITIONS))


def next_step(now: State, wanted: Setting) -> str:
    """The next command on the way to a setting, "" when it is reached; auto-range goes off first."""
    if wanted.output and now.auto_range:
        return ":SOUR:CURR:RANG:AUTO 0"
    return COMMANDS.next_step(
        now.setting, wanted, level_step_a=step_a(wanted.range_a), compliance_step_v=COMPLIANCE_STEP_V
    )
