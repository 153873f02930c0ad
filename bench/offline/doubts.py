"""Doubts about the result of a case: implausible data (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from bench.metrology.plausibility import Doubt

SIGNS_OR_ROWS = ": see the signs of the output, and whether rows are displaced"


def with_doubts(result: dict[str, Any], doubts: Iterable[Doubt]) -> dict[str, Any]:
    """Add flags and notes of the doubts to a result; a doubtful result has no verdict, and is incomplete."""
    with np.errstate(all="ignore"):  # readings that are not plausible numbers
        found = list(doubts)
    flags = [flag for flag in dict.fromkeys(doubt.flag for doubt in found) if flag]
    changed: dict[str, Any] = {
        "flags": [*result["flags"], *flags],
        "lacking": [*result["lacking"], *flags],
        "notes": [*result["notes"], *dict.fromkeys(doubt.note for doubt in found)],
    }
    if flags and "passed" in result:
        changed["passed"] = None
    if flags and "verdict" in result:
        changed["verdict"] = "invalid"
    return result | changed
