"""The few SCPI headers that laboratory supplies share, and what is to be sent next to reach a setting.

After the SCPI-1999 instrument class for power supplies; no maker's own commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers import scpi

# Headers as a simulator matches them
VOLTAGE = "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]"
CURRENT = "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]"
OUTPUT = "OUTPut[:STATe]"
MEASURE_VOLTAGE = "MEASure[:SCALar]:VOLTage[:DC]"
MEASURE_CURRENT = "MEASure[:SCALar]:CURRent[:DC]"
MEASURE_POWER = "MEASure[:SCALar]:POWer[:DC]"
OVER_VOLTAGE = "[SOURce:]VOLTage:PROTection:TRIPped"
OVER_CURRENT = "[SOURce:]CURRent:PROTection:TRIPped"

STATE_QUERY = b"MEAS:VOLT?;:MEAS:CURR?;:OUTP?;:VOLT?;:CURR?"
MAXIMUM_QUERY = b"VOLT? MAX;:CURR? MAX"
TRIPS = {"over_voltage": b"VOLT:PROT:TRIP?", "over_current": b"CURR:PROT:TRIP?"}
OFF = "OUTP OFF"

LEVEL_WITHIN_V = 0.001  # finer than any unit needs, not finer than a supply resolves
LIMIT_WITHIN_A = 0.001
STEADY_WITHIN = 0.05  # relative: what a unit at work may change its voltage and current by from one answer to the next
STEADY_WITHIN_V, STEADY_WITHIN_A = 0.02, 0.005  # and in any case: what a supply resolves, and its noise


@dataclass(frozen=True, slots=True)
class Setting:
    """What an output is to do: its level, its current limit, and whether it is on."""

    level_v: float
    limit_a: float
    output: bool


@dataclass(frozen=True, slots=True)
class State:
    """What a supply measures, what it is set to, and which of its protections have tripped, as in TRIPS."""

    voltage_v: float
    current_a: float
    setting: Setting
    tripped: tuple[str, ...] = ()


def state_query(trips: Sequence[str]) -> bytes:
    """The question for the state, with those protections that the supply tells of."""
    return b";:".join([STATE_QUERY, *(TRIPS[trip] for trip in trips)])


def read_state(line: bytes, trips: Sequence[str] = ()) -> State:
    """The answer to `state_query`; ValueError."""
    voltage, current, output, level, limit, *told = scpi.answers(line, 5 + len(trips))
    setting = Setting(scpi.number(level), scpi.number(limit), scpi.boolean(output))
    tripped = tuple(trip for trip, has in zip(trips, told, strict=True) if scpi.boolean(has))
    return State(scpi.number(voltage), scpi.number(current), setting, tripped)


def read_maximum(line: bytes) -> tuple[float, float]:
    """The answer to MAXIMUM_QUERY: the highest level (V) and the highest limit (A); ValueError."""
    most_v, most_a = scpi.answers(line, 2)
    return scpi.number(most_v), scpi.number(most_a)


def steady(one: State, other: State) -> bool:
    """Whether what is measured in two answers, one right after the other, may be of an output that stands still."""
    return abs(one.voltage_v - other.voltage_v) <= STEADY_WITHIN_V + STEADY_WITHIN * abs(one.voltage_v) and abs(
        one.current_a - other.current_a
    ) <= STEADY_WITHIN_A + STEADY_WITHIN * abs(one.current_a)


def next_step(now: Setting, wanted: Setting) -> str:
    """The next command on the way from one setting to another, "" when it is reached.

    Limit and level come before the output goes on.
    """
    if abs(now.limit_a - wanted.limit_a) > LIMIT_WITHIN_A:
        return f"CURR {scpi.spell(wanted.limit_a)}"
    if abs(now.level_v - wanted.level_v) > LEVEL_WITHIN_V:
        return f"VOLT {scpi.spell(wanted.level_v)}"
    if now.output != wanted.output:
        return "OUTP ON" if wanted.output else OFF
    return ""
