"""Common SCPI headers of laboratory supplies, and the sequence of commands to a setting.

Source: the SCPI-1999 instrument class for power supplies. The watchdog is that of Keysight (Operating and Service
Guides of the N6900 and N7900 series, pages 252 and 287, and of the N6700C, page 158): when no remote interface has had
any traffic for its delay, the output is latched off. OUTP? does not show that, bit 11 of the questionable status does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from drivers.protocols import scpi

# Headers for the simulator
VOLTAGE = "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]"
CURRENT = "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]"
OUTPUT = "OUTPut[:STATe]"
MEASURE_VOLTAGE = "MEASure[:SCALar]:VOLTage[:DC]"
MEASURE_CURRENT = "MEASure[:SCALar]:CURRent[:DC]"
MEASURE_POWER = "MEASure[:SCALar]:POWer[:DC]"
OVER_VOLTAGE = "[SOURce:]VOLTage:PROTection:TRIPped"
OVER_CURRENT = "[SOURce:]CURRent:PROTection:TRIPped"

WATCHDOG = "OUTPut:PROTection:WDOG[:STATe]"
WATCHDOG_DELAY = "OUTPut:PROTection:WDOG:DELay"
QUESTIONABLE = "STATus:QUEStionable:CONDition"

STATE_QUERY = b"MEAS:VOLT?;:MEAS:CURR?;:OUTP?;:VOLT?;:CURR?"
MAXIMUM_QUERY = b"VOLT? MAX;:CURR? MAX"
TRIPS = {"over_voltage": b"VOLT:PROT:TRIP?", "over_current": b"CURR:PROT:TRIP?"}
WATCHDOG_QUERY = b"OUTP:PROT:WDOG?;:OUTP:PROT:WDOG:DEL?;:STAT:QUES:COND?"
PROTECTED = 2048  # bit of the questionable status: the watchdog has switched the output off
OFF = "OUTP OFF"

LEVEL_WITHIN_V = 0.001  # finer than needed by any unit, not finer than the resolution of a supply
LIMIT_WITHIN_A = 0.001
STEADY_WITHIN = 0.05  # relative: possible change of voltage and current of a working unit between two answers
STEADY_WITHIN_V, STEADY_WITHIN_A = 0.02, 0.005  # absolute: resolution and noise of a supply


class Setting(NamedTuple):
    """Wanted setting of the output: level, current limit, on or off, and watchdog delay; 0 for none."""

    level_v: float
    limit_a: float
    output: bool
    watchdog_s: float = 0.0

    def switched_off(self) -> Setting:
        """The same with output and watchdog off."""
        return self._replace(output=False, watchdog_s=0.0)

    def __str__(self) -> str:
        return f"{self.level_v:g} V, limit {self.limit_a:g} A, output {'on' if self.output else 'off'}"


class State(NamedTuple):
    """State of a supply: measured values, settings, and tripped protections, in the order of TRIPS."""

    voltage_v: float
    current_a: float
    setting: Setting
    tripped: tuple[str, ...] = ()


def state_query(trips: Sequence[str], *, watchdog: bool = False) -> bytes:
    """Query of the state, with the protections that the supply reports."""
    return b";:".join([STATE_QUERY, *(TRIPS[trip] for trip in trips), *([WATCHDOG_QUERY] if watchdog else [])])


@lru_cache(maxsize=64)  # a supply with a steady load gives the same answer
def read_state(line: bytes, trips: tuple[str, ...] = (), *, watchdog: bool = False) -> State:
    """Decode the answer to `state_query`; ValueError."""
    voltage, current, output, level, limit, *further = scpi.answers(line, 5 + len(trips) + 3 * watchdog)
    tripped = [trip for trip, has in zip(trips, further, strict=False) if scpi.boolean(has)]
    watchdog_s = 0.0
    if watchdog:
        armed, delay, questionable = further[len(trips) :]
        watchdog_s = scpi.number(delay) if scpi.boolean(armed) else 0.0
        if int(scpi.number(questionable)) & PROTECTED:
            tripped.append("watchdog")
    setting = Setting(scpi.number(level), scpi.number(limit), scpi.boolean(output), watchdog_s)
    return State(scpi.number(voltage), scpi.number(current), setting, tuple(tripped))


def read_maximum(line: bytes) -> tuple[float, float]:
    """Decode the answer to MAXIMUM_QUERY: maximum level (V) and maximum limit (A); ValueError."""
    max_v, max_a = scpi.answers(line, 2)
    return scpi.number(max_v), scpi.number(max_a)


def steady(one: State, other: State) -> bool:
    """Return whether two consecutive measurements agree within the tolerance of a steady output."""
    return abs(one.voltage_v - other.voltage_v) <= STEADY_WITHIN_V + STEADY_WITHIN * abs(one.voltage_v) and abs(
        one.current_a - other.current_a
    ) <= STEADY_WITHIN_A + STEADY_WITHIN * abs(one.current_a)


def next_step(now: Setting, wanted: Setting) -> str:
    """The next command on the way from one setting to another, "" when it is reached.

    Limit, level and watchdog come before the output goes on; the watchdog ends after the output has gone off.
    """
    if now.output and not wanted.output:
        return OFF
    if abs(now.limit_a - wanted.limit_a) > LIMIT_WITHIN_A:
        return f"CURR {scpi.spell(wanted.limit_a)}"
    if abs(now.level_v - wanted.level_v) > LEVEL_WITHIN_V:
        return f"VOLT {scpi.spell(wanted.level_v)}"
    if now.watchdog_s != wanted.watchdog_s:
        if not wanted.watchdog_s:
            return "OUTP:PROT:WDOG OFF"
        return f"OUTP:PROT:WDOG:DEL {wanted.watchdog_s:.0f};:OUTP:PROT:WDOG ON"
    return "OUTP ON" if wanted.output and not now.output else ""
