"""Outcome of a reduced case: its verdict, and its completeness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Outcome = Literal["REDUCED", "PASS", "FAIL", "INCOMPLETE"]


@dataclass(frozen=True, slots=True)
class ReducedCase:
    """The content of `result.json`, and what makes it incomplete: some of its flags, "nothing" if it has no result."""

    content: dict[str, Any]
    lacking: tuple[str, ...]

    @property
    def outcome(self) -> Outcome:
        """PASS or FAIL of a case with limits, REDUCED without any; INCOMPLETE if something is unknown.

        A failure counts even if something else is unknown, unless the whole is doubtful.
        """
        of = self.content
        judged = {"pass": True, "fail": False}.get(of["verdict"]) if "verdict" in of else of.get("passed")
        if judged is False:
            return "FAIL"
        is_judged = "verdict" in of or "passed" in of
        if self.lacking or (is_judged and judged is None):
            return "INCOMPLETE"
        return "PASS" if judged else "REDUCED"
