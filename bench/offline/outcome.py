"""Outcome of a reduced case: its verdict, and its completeness."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal

from bench.offline.case import reduction_of

Outcome = Literal["REDUCED", "PASS", "FAIL", "INCOMPLETE"]

LACKING = r"(^|[: ])invalid$|too_few_|_missing$|^implausible_|^(columns|legs)_exchanged$"
"""Flags of a part that could not be used, or of a result that is not reliable; a reduction may add others."""


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
    reduction = reduction_of(result["method"], result["sub"])
    own, names = (reduction.lacking, reduction.parts) if reduction is not None else ("", ())
    found = [flag for flag in result["flags"] if re.search("|".join(filter(None, (LACKING, own))), flag)]
    parts = [result[name] for name in names]
    nothing = any(not part or all(each is None for each in part) for part in parts)
    return [*found, "nothing"] if nothing else found
