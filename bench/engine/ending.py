"""How a run ended, and who asked for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

How = Literal["completed", "failed", "error", "aborted"]


@dataclass(frozen=True, slots=True)
class EndRequest:
    """Who wants a run to end: `by` is a stable name for the record, `text` is for people."""

    by: str
    text: str


OPERATOR = EndRequest("operator", "ended by the operator")


@dataclass
class Outcome:
    """How a run ended: `failed` is what the unit did, `error` what the bench did.

    `problems` are for people, the first one is why. `unsafe` names devices that could not be made safe, `not_reached`
    those that could not be opened, so that nothing was sent to them; both with the reason. `ended_by` is who asked for
    the end before the plan was done. `held` are chambers that were left at their set point, for their guardian to end.
    """

    how: How = "completed"
    problems: list[str] = field(default_factory=list)
    unsafe: dict[str, str] = field(default_factory=dict)
    not_reached: dict[str, str] = field(default_factory=dict)
    held: list[str] = field(default_factory=list)
    ended_by: EndRequest | None = None

    def ended(self, request: EndRequest) -> None:
        """The run was ended on request; the first request counts, and a failure before it stays what it was."""
        if self.ended_by is None:
            self.ended_by = request
        if self.how == "completed":
            self.how = "aborted"
        if self.ended_by.text not in self.problems:
            self.problems.append(self.ended_by.text)

    def failed(self, text: str) -> None:
        """The bench or this program failed; a problem is listed once."""
        self.how = "error"
        if text not in self.problems:
            self.problems.append(text)
