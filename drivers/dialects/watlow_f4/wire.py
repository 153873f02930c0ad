"""Registers of a Watlow F4 S or D ⇄ values, both directions.

Addresses are those on the wire: the numbers of the maker's table. A temperature is one word with a sign and an implied
decimal point, whose place is a setting of the controller (register 606: 0 whole degrees, 1 tenths, 2 hundredths, 3
thousandths).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from drivers.kinds.chamber.words import int16_value, int16_word

MODEL_F4 = 5270
EVENT_OUTPUTS = 8
MAX_DECIMALS = 3


class Register(IntEnum):
    """Register addresses of channel 1, the temperature."""

    MODEL = 0
    SERIAL_FIRST = 1
    SERIAL_LAST = 2
    SOFTWARE = 3
    REVISION = 4  # in hundredths
    PROCESS_VALUE = 100
    INPUT_ERROR = 101
    ALARM_1 = 102
    ALARM_2 = 106
    STATUS = 200
    SET_POINT = 300
    SET_POINT_MIN = 602
    SET_POINT_MAX = 603
    DECIMALS = 606
    DISPLAY_UNIT = 901
    RESUME = 1209
    HOLD = 1210
    TERMINATE = 1217
    EVENT_1 = 2000
    PROFILE = 4000
    PROFILE_STEP = 4001
    PROFILE_ACTION = 4002
    PROFILE_SET_POINT = 4122


class Status(IntEnum):
    """Source of the active set point."""

    STATIC = 0
    STATIC_TOO = 1
    PROFILE_RUNS = 2
    PROFILE_ON_HOLD = 3


class DisplayUnit(IntEnum):
    """Unit of every temperature on the wire."""

    FAHRENHEIT = 0
    CELSIUS = 1


START_PROFILE = 5  # the action at PROFILE_ACTION
MEASURED_FIRST = Register.PROCESS_VALUE
MEASURED_COUNT = Register.ALARM_2 + 1 - MEASURED_FIRST
INPUT_ERRORS = {1: "A/D underflow", 2: "sensor under range", 3: "sensor over range"}
_ALARMS = {1: "high", 2: "low"}


@dataclass(frozen=True, slots=True)
class Measured:
    """Decoded MEASURED_COUNT registers from MEASURED_FIRST; `alarm` is empty without an alarm."""

    process_value_c: float
    input_error: int
    alarm: str


@dataclass(frozen=True, slots=True)
class TemperatureFormat:
    """Temperature format of one controller."""

    decimals: int = 1

    def word(self, temperature_c: float) -> int:
        """Encode a temperature, rounded to its last decimal; OverflowError if it does not fit one register."""
        return int16_word(round(temperature_c * 10.0**self.decimals))

    def value_c(self, word: int) -> float:
        """Decode the temperature in a register."""
        return int16_value(word) / 10.0**self.decimals

    def measured(self, words: Sequence[int]) -> Measured:
        """Decode the registers from MEASURED_FIRST."""
        alarms = {1: words[Register.ALARM_1 - MEASURED_FIRST], 2: words[Register.ALARM_2 - MEASURED_FIRST]}
        active = [f"alarm {n} {_ALARMS.get(state, state)}" for n, state in alarms.items() if state]
        return Measured(self.value_c(words[0]), words[Register.INPUT_ERROR - MEASURED_FIRST], ", ".join(active))


def event_output(number: int) -> int:
    """Register of an event output, 1 to EVENT_OUTPUTS: 0 is off, 1 is on."""
    return Register.EVENT_1 + 10 * (number - 1)
