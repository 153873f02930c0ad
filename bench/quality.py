"""Readings by their quality: only what is `Valid` can decide a wait, an interlock or a result.

Drivers return a raw `drivers.values.Reading`. It becomes a `Valid` or an `Invalid` where it is taken in, and nowhere
else; whatever decides accepts `Valid` only, which the type checker proves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from bench.errors import StepError
from drivers.values import Reading


class Valid(NamedTuple):
    """An accepted reading: loop time in s at which it was true, value in the unit of its channel, number from 1."""

    at_s: float
    value: float
    number: int


class Invalid(NamedTuple):
    """A reading that is not to be used, and why, to follow the name of its channel. It has no value to use by mistake.

    It is rejected, or too old: `at_s` is its own time in either case.
    """

    at_s: float
    why: str
    number: int


Latest = Valid | Invalid


def numbered(readings: Sequence[Reading], name: str, first: int) -> list[Valid]:
    """Readings that are asked for one by one and enter a result; StepError for what is not a finite number."""
    for reading in readings:
        if not math.isfinite(reading.value):
            raise StepError(f"{name}: a reading was not a number and is not used; check the instrument")
    return [Valid(reading.at_s, reading.value, first + number) for number, reading in enumerate(readings)]
