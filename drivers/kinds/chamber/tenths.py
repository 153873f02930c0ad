"""Set points in tenths of a degree, as they are transmitted in text."""

from __future__ import annotations

TENTHS = 10


def as_stored(temperature_c: float) -> float:
    """Set point rounded to the transmitted tenth of a degree."""
    return round(temperature_c * TENTHS) / TENTHS
