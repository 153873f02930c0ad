"""Ranges shared by descriptions: the range in which an instrument is locked, and limits of a source."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import AfterValidator

from drivers.schema.fields import Amperes, Range, StrictModel
from drivers.schema.wording import telling


def range_of(known: Iterable[float], unit: str, words: str) -> AfterValidator:
    """Validate a number, in any unit, into the known range that it names; `words` lists them."""

    def named(value: float) -> float:
        for one in known:
            if abs(value - one) < 1e-6 * one:
                return one
        raise telling(f"is {value:g} {unit}, expected {words}")

    return AfterValidator(named)


class LevelRange(Range):
    """From `min` to `max`, inclusive."""

    min: Amperes
    max: Amperes


class SourceLimits(StrictModel):
    """Limits that protect the coil on the source."""

    current: LevelRange
