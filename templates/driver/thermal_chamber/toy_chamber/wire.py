"""Messages of the chamber ⇄ values, both directions; no I/O.

Source: its manual, which is the table in README.md. Temperatures are in °C, a set point has one decimal.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from drivers.protocols import scpi

# Headers for the simulator: capitals may stand alone
TEMPERATURE, SET_POINT, MODE, LIMITS = "TEMPerature", "SETPoint", "MODE", "LIMits"

STATE_QUERY = b"TEMP?;:SETP?;:MODE?"
LIMITS_QUERY = b"LIM?"
TENTHS = 10


class Mode(Enum):
    """Operating modes of the chamber."""

    OFF = "OFF"
    ON = "ON"
    PROGRAM = "PROG"


@dataclass(frozen=True, slots=True)
class State:
    """Answer to STATE_QUERY."""

    air_c: float
    set_point_c: float
    mode: Mode


def read_state(line: bytes) -> State:
    """Decode `23.41;25.0;ON`; ValueError."""
    air, set_point, mode = scpi.answers(line, 3)
    return State(scpi.number(air), scpi.number(set_point), Mode(mode))


def read_limits(line: bytes) -> tuple[float, float]:
    """Decode `-40.0,120.0`: minimum and maximum set point, °C; ValueError."""
    (answer,) = scpi.answers(line, 1)
    low, high = answer.split(",")
    return scpi.number(low), scpi.number(high)


def as_stored(temperature_c: float) -> float:
    """Set point as stored by the chamber, rounded to a tenth of a degree."""
    return round(temperature_c * TENTHS) / TENTHS


def set_point(temperature_c: float) -> str:
    """Command: set point."""
    return f"SETP {as_stored(temperature_c):.1f}"


def mode(mode: Mode) -> str:
    """Command: enter a mode."""
    return f"MODE {mode.value}"
