"""Yokogawa GS200 headers and answers, and the sequence of commands to a setting.

Sources: headers, ranges and bits of the condition register as in the user's manual (IM GS210-01EN, chapter 13),
confirmed by two third-party drivers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal

from drivers.kinds.source.setting import Commands, Setting
from drivers.protocols import scpi

Function = Literal["CURR", "VOLT"]
FUNCTIONS: Mapping[str, Function] = {"CURR": "CURR", "VOLT": "VOLT"}

# Headers for the simulator
FUNCTION = "[SOURce:]FUNCtion"
RANGE = "[SOURce:]RANGe"
LEVEL = "[SOURce:]LEVel[:FIXed]"
AUTO_LEVEL = "[SOURce:]LEVel:AUTO"
COMPLIANCE = "[SOURce:]PROTection:VOLTage"
CURRENT_LIMIT = "[SOURce:]PROTection:CURRent"
OUTPUT = "OUTPut[:STATe]"
CONDITION = "STATus:CONDition"
EVENT = "STATus:EVENt"

STATE_QUERY = b":SOUR:FUNC?;:SOUR:RANG?;:SOUR:LEV?;:SOUR:PROT:VOLT?;:OUTP?;:STAT:COND?"
AS_CURRENT = ":SOUR:FUNC CURR"
COMMANDS = Commands(
    range=":SOUR:RANG", compliance=":SOUR:PROT:VOLT", level=":SOUR:LEV", on=":OUTP 1", off=":OUTP 0"
)  # fmt: skip

RANGES_A = (1e-3, 10e-3, 100e-3, 200e-3)
OVER_RANGE = 1.2
LEVEL_MAX_A = 0.2  # independent of the range
COMPLIANCE_MIN_V, COMPLIANCE_MAX_V, COMPLIANCE_STEP_V = 1.0, 30.0, 1.0


class Condition(IntFlag):
    """Used bits of the condition register."""

    LOW_LIMITING = 1 << 10
    HIGH_LIMITING = 1 << 11
    EMERGENCY = 1 << 13


_CONDITIONS = sum(Condition)
NO_CONDITION = Condition(0)
LIMITING = Condition.LOW_LIMITING | Condition.HIGH_LIMITING


@dataclass(frozen=True, slots=True)
class State:
    """Settings of a source: levels in `setting` are volts instead of amperes while `function` is VOLT."""

    function: Function
    setting: Setting
    condition: Condition = NO_CONDITION


def max_a(range_a: float) -> float:
    """Largest level of a range."""
    return min(OVER_RANGE * range_a, LEVEL_MAX_A)


def step_a(range_a: float) -> float:
    """Resolution of a level: six digits, so 10 nA at 1 mA, and 1 µA at 100 mA and at 200 mA."""
    return min(1e-5 * range_a, 1e-6)


def read_state(line: bytes) -> State:
    """Decode the answer to STATE_QUERY; ValueError."""
    function, range_, level, compliance, output, condition = scpi.answers(line, 6)
    if function not in FUNCTIONS:
        raise ValueError(f"'{function}' is neither CURR nor VOLT")
    setting = Setting(scpi.number(range_), scpi.number(level), scpi.number(compliance), scpi.boolean(output))
    return State(FUNCTIONS[function], setting, Condition(scpi.integer(condition) & _CONDITIONS))


def next_step(now: State, wanted: Setting) -> str:
    """Next command on the way to a setting, "" when it is reached; voltage mode ends at 0 V with the output off."""
    if wanted.output and now.function != "CURR":
        return COMMANDS.step_off(now.setting) or AS_CURRENT
    return COMMANDS.next_step(
        now.setting, wanted, level_step_a=step_a(wanted.range_a), compliance_step_v=COMPLIANCE_STEP_V
    )
