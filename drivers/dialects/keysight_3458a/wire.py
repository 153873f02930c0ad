"""Keysight 3458A messages and answers; its language is its own, older than SCPI.

Sources: the user's guide (03458-90014: chapters 3, 4 and 6, appendix on throughput). Formats of answers are those
recorded from instruments by third parties, such as `10.0000000E+00` to NPLC? and `1, .1` to FUNC?.

A message may hold several commands, separated by semicolons, but only one query: a second answer overwrites the first.
Answers end with CR and LF.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from drivers.protocols import scpi
from drivers.protocols.scpi import ErrorEntry
from drivers.protocols.texts import matched
from drivers.values import Identity

END = b"\n"  # a CR before it would end the command, and the LF an empty one
RANGES_V = (0.1, 1.0, 10.0, 100.0, 1000.0)
RANGES_A = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
NPLCS = (*range(1, 11), *range(20, 101, 10))  # values accepted without rounding up
OVERLOAD = 1e38  # in V or A; reported for an input over range

# The instrument measures continuously until its trigger is held, and its readings would be taken for answers; a gateway
# detects the end of answers only with END ALWAYS.
IDENTITY_QUERY = b"TARM HOLD;END ALWAYS;ID?"
REVISION_QUERY = b"REV?"
CALIBRATIONS_QUERY = b"CALNUM?"
LINE_FREQUENCY_QUERY = b"LFREQ?"
ERROR_QUERY = b"ERRSTR?"
TRIGGER = b"TARM SGL"  # answered by the reading, at its end

_ON, _OFF, _HOLD = 1.0, 0.0, 4.0
_CONTINUOUS_NPLC = 10  # a longer reading is the mean of several of this length
_OWN_ERRORS = {
    100,
    101,
    108,
    109,
    110,
}  # errors of hardware, calibration, destructive overload, out of calibration, calibration due
_AUXILIARY_ERRORS = 200  # from this bit on: parts of the hardware

_AROUND = " \r"  # whitespace around a number; Python alone would accept control characters, too
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d{1,2})?", re.ASCII)
_IDENTITY = re.compile(r"(HP|Agilent|Keysight) ?(3458A)", re.ASCII | re.IGNORECASE)


class Function(NamedTuple):
    """Function: its command, the answer to FUNC?, and the unit of its readings."""

    command: str
    code: float
    unit: str


DC_VOLTS = Function("DCV", 1.0, "V")
DC_CURRENT = Function("DCI", 6.0, "A")


class Setting(NamedTuple):
    """Measurement setting: range (V or A), integration time in power line cycles, and function."""

    full_scale: float
    nplc: float
    function: Function = DC_VOLTS


def set_up(setting: Setting) -> bytes:
    """Message that sets up the instrument from any state and makes it wait for a trigger; it is acknowledged as TARM?.

    The input buffer releases the bus during a reading, so that a gateway is not held up. It is off after a power
    failure, which shows in `state_when`.
    """
    return (
        "PRESET NORM;TARM HOLD;TRIG AUTO;INBUF ON;END ALWAYS;QFORMAT NORM;"
        f"{setting.function.command} {setting.full_scale:G};NPLC {setting.nplc:g};AZERO ON;TARM?"
    ).encode()


def state_when(setting: Setting) -> Mapping[bytes, tuple[float, ...]]:
    """Expected answers, query by query, of an instrument with this setup that waits for a trigger.

    An answer may have further numbers.
    """
    measured = (setting.function.code, setting.full_scale)
    return {
        b"TARM?": (_HOLD,), b"FUNC?": measured, b"NPLC?": (setting.nplc,), b"AZERO?": (_ON,), b"MATH?": (_OFF,),
        b"INBUF?": (_ON,),
    }  # fmt: skip


def duration_s(nplc: float, line_hz: float) -> float:
    """Duration of a reading including its zero, which is measured for as long as the input."""
    return 2 * nplc / line_hz


def last_zero_s(nplc: float, line_hz: float) -> float:
    """Duration of the last zero; before it, the input (and in long readings other zeros, alternating) is measured."""
    return min(nplc, _CONTINUOUS_NPLC) / line_hz


def middle_before_answer_s(nplc: float, line_hz: float) -> float:
    """Time from the middle of a reading to its answer."""
    return (duration_s(nplc, line_hz) + last_zero_s(nplc, line_hz)) / 2


def read_identity(line: bytes) -> Identity:
    """Decode the answer to ID?: maker and model, all that the wire reports; ValueError."""
    match = matched(_IDENTITY, line.decode("ascii").strip(_AROUND), "not a 3458A")
    return Identity(maker=match[1], model=match[2].upper(), verified=False)


def read_numbers(line: bytes) -> tuple[float, ...]:
    """Decode the comma-separated numbers of an answer; ValueError."""
    texts = [text.strip(_AROUND) for text in line.decode("ascii").split(",")]
    for text in texts:
        if _NUMBER.fullmatch(text) is None or not math.isfinite(float(text)):
            raise ValueError(f"'{text}' is not a number")
    return tuple(map(float, texts))


def read_number(line: bytes) -> float:
    """Decode an answer of one number, such as a reading (V or A), which is ± OVERLOAD over range; ValueError."""
    numbers = read_numbers(line)
    if len(numbers) != 1:
        raise ValueError(f"{len(numbers)} numbers, expected one")
    return numbers[0]


def read_error(line: bytes) -> ErrorEntry:
    """Decode the answer to ERRSTR?, like `106,"PARAMETER OUT OF RANGE"`, code 0 if there is none; ValueError."""
    return scpi.error_entry(line.strip(_AROUND.encode()))


def is_own_fault(entry: ErrorEntry) -> bool:
    """Return whether an error is a fault of the instrument itself, not of a message."""
    return entry.code in _OWN_ERRORS or entry.code >= _AUXILIARY_ERRORS
