"""Outcome of a reduced case: its verdict, and its completeness."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal

Outcome = Literal["REDUCED", "PASS", "FAIL", "INCOMPLETE"]

# flags of one method each; with any of them a part of the result is missing
PARTS = ("runs", "table", "points", "dvx_mps")
LACKING = re.compile(
    r"(^|[: ])invalid$|insufficient_temperature_span$|too_few_|_missing$|:missing_|:attitude_inconsistent:"
    r"| incomplete: |^radius_not_determined$|^implausible_|^(columns|legs)_exchanged$"
)
"""Flags of a part that could not be used, or of a result that is not reliable."""


def outcome(result: Mapping[str, Any]) -> Outcome:
    """PASS or FAIL of a case with limits, REDUCED without any; INCOMPLETE if something is unknown.

    A failure counts even if something else is unknown, unless the whole is doubtful.
    """
    judged = {"pass": True, "fail": False}.get(result["verdict"]) if "verdict" in result else result.get("passed")
    if judged is False:
        return "FAIL"
    is_judged = "verdict" in result or "passed" in result
    if lacking(result) or (is_judged and judged is None):
        return "INCOMPLETE"
    return "PASS" if judged else "REDUCED"


def lacking(result: Mapping[str, Any]) -> list[str]:
    """Flags of missing results; "nothing" if there is no part at all, or none is known."""
    found = [flag for flag in result["flags"] if LACKING.search(flag)]
    parts = [result[name] for name in PARTS if name in result]
    nothing = any(not part or all(each is None for each in part) for part in parts)
    return [*found, "nothing"] if nothing else found
