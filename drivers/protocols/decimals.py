"""Numbers as plain decimals, for controllers that do not read exponents."""

from __future__ import annotations


def decimal(value: float) -> str:
    """Format with one to six digits after the point: 1e-6° is 0.004 arcsec; never -0."""
    whole, _, digits = f"{round(value, 6) + 0.0:.6f}".partition(".")
    return f"{whole}.{digits.rstrip('0') or '0'}"
