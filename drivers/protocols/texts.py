"""Decimals and patterns in messages of text."""

from __future__ import annotations

import re


def decimal(value: float) -> str:
    """Format with one to six digits after the point: 1e-6° is 0.004 arcsec; never -0, and never an exponent."""
    whole, _, digits = f"{round(value, 6) + 0.0:.6f}".partition(".")
    return f"{whole}.{digits.rstrip('0') or '0'}"


def matched(form: re.Pattern[str], text: str, otherwise: str) -> re.Match[str]:
    """Match a complete text; ValueError with the message `otherwise` if it has another form."""
    match = form.fullmatch(text)
    if match is None:
        raise ValueError(otherwise)
    return match
