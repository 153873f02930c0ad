"""Names of input levels, in results and in messages: up_1g, skew, src_12g."""

from __future__ import annotations

LEVEL_DIGITS_G = 3  # levels closer to each other are one level
SKEW_G = 0.577  # level of three axes at equal angles to the vertical, 1/√3
USUAL = {1.0: "up_1g", -1.0: "down_1g", SKEW_G: "skew"}


def level_name(level_g: float, *, by_source: bool) -> str:
    """Return the name of a level of a current source, or of gravity."""
    rounded_g = round(level_g, LEVEL_DIGITS_G) + 0.0
    if by_source:
        return f"src_{rounded_g:g}g"
    return USUAL.get(rounded_g, f"gravity_{rounded_g:g}g")
