"""Outcome of a run, and requests to end it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

How = Literal["completed", "failed", "error", "aborted"]


class EndRequest(NamedTuple):
    """A request to end a run: `by` is a stable name for the record, `text` is for people."""

    by: str
    text: str


OPERATOR = EndRequest("operator", "ended by the operator")


@dataclass
class Outcome:
    """Outcome of a run: `failed` concerns the unit, `error` the bench.

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
        """Return the outcome after a request to end: the first request counts, and an earlier failure is kept."""
        if self.ended_by is None:
            self.ended_by = request
        if self.how == "completed":
            self.how = "aborted"
        if self.ended_by.text not in self.problems:
            self.problems.append(self.ended_by.text)

    def failed(self, text: str) -> None:
        """Return the outcome after a failure of the bench or of this program; each problem is listed once."""
        self.how = "error"
        if text not in self.problems:
            self.problems.append(text)
