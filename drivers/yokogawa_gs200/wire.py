"""Yokogawa GS200 headers and answers, and what is to be sent next to reach a setting.

Headers and ranges after the user's manual (IM GS210-01EN, chapter 13) as two drivers of other people use them. What the
bits of its status registers mean is in no source that could be read: they are not used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from drivers import scpi
from drivers.source.setting import Commands, Setting

Function = Literal["CURR", "VOLT"]
FUNCTIONS: Mapping[str, Function] = {"CURR": "CURR", "VOLT": "VOLT"}

# Headers as a simulator matches them
FUNCTION = "[SOURce:]FUNCtion"
RANGE = "[SOURce:]RANGe"
LEVEL = "[SOURce:]LEVel[:FIXed]"
AUTO_LEVEL = "[SOURce:]LEVel:AUTO"
COMPLIANCE = "[SOURce:]PROTection:VOLTage"
CURRENT_LIMIT = "[SOURce:]PROTection:CURRent"
OUTPUT = "OUTPut[:STATe]"

STATE_QUERY = b":SOUR:FUNC?;:SOUR:RANG?;:SOUR:LEV?;:SOUR:PROT:VOLT?;:OUTP?"
AS_CURRENT = ":SOUR:FUNC CURR"
COMMANDS = Commands(
    range=":SOUR:RANG", compliance=":SOUR:PROT:VOLT", level=":SOUR:LEV", on=":OUTP 1", off=":OUTP 0"
)  # fmt: skip

RANGES_A = (1e-3, 10e-3, 100e-3, 200e-3)
OVER_RANGE = 1.2
LEVEL_MAX_A = 0.2  # whatever the range
COMPLIANCE_MIN_V, COMPLIANCE_MAX_V, COMPLIANCE_STEP_V = 1.0, 30.0, 1.0


@dataclass(frozen=True, slots=True)
class State:
    """What a source is set to: `setting` is in volts where amperes are meant while `function` is VOLT."""

    function: Function
    setting: Setting


def most_a(range_a: float) -> float:
    """The largest level of a range."""
    return min(OVER_RANGE * range_a, LEVEL_MAX_A)


def step_a(range_a: float) -> float:
    """What a level is rounded to: six digits, so that it is 10 nA at 1 mA, and 1 µA at 100 mA and at 200 mA."""
    return min(1e-5 * range_a, 1e-6)


def read_state(line: bytes) -> State:
    """The answer to STATE_QUERY; ValueError."""
    function, range_, level, compliance, output = scpi.answers(line, 5)
    if function not in FUNCTIONS:
        raise ValueError(f"'{function}' is neither CURR nor VOLT")
    setting = Setting(scpi.number(range_), scpi.number(level), scpi.number(compliance), scpi.boolean(output))
    return State(FUNCTIONS[function], setting)


def next_step(now: State, wanted: Setting) -> str:
    """The next command on the way to a setting, "" when it is reached; volts end at 0 V with the output off."""
    if wanted.output and now.function != "CURR":
        return COMMANDS.step_off(now.setting) or AS_CURRENT
    return COMMANDS.next_step(
        now.setting, wanted, level_step_a=step_a(wanted.range_a), compliance_step_v=COMPLIANCE_STEP_V
    )
