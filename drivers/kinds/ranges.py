"""Ranges that descriptions share: the one that an instrument is locked in, and what a bench allows a source."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import AfterValidator

from drivers.schema.fields import Amperes, Range, StrictModel
from drivers.schema.wording import telling


def range_of(known: Iterable[float], unit: str, words: str) -> AfterValidator:
    """Validates a number into the known range that it names, whatever unit it was written in; `words` tell them all."""

    def named(value: float) -> float:
        for one in known:
            if abs(value - one) < 1e-6 * one:
                return one
        raise telling(f"is {value:g} {unit}, expected {words}")

    return AfterValidator(named)


class LevelRange(Range):
    """From `min` to `max`, both allowed."""

    min: Amperes
    max: Amperes


class SourceLimits(StrictModel):
    """What the bench allows the source, for the sake of the coil on it."""

    current: LevelRange
