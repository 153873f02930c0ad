"""Findings of the rules on a plan as a whole, with severity and place in the document."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from bench.config.document import Document, Place
from bench.config.models import BenchFile
from bench.sequence.plan.plan import Plan

Severity = Literal["error", "warning"]
Found = tuple[Place, str, str]  # where a plan is not as it should be, what is wrong there, and what to do instead


class Rule(NamedTuple):
    """One rule on a whole plan; `name` is stable, `title` states what holds if nothing is found."""

    name: str
    severity: Severity
    title: str
    find: Callable[[Plan, BenchFile], Iterator[Found]]


@dataclass(frozen=True, slots=True)
class Remark:
    """What a rule found: a run with an error is refused, a run with a warning goes on.

    `elsewhere` is the document that `place` is in, where that is not the sequence.
    """

    severity: Severity
    rule: str
    place: Place
    problem: str
    advice: str
    elsewhere: Document | None = field(default=None, compare=False, repr=False)

    def document(self, sequence: Document) -> Document:
        """The document that it is on."""
        return self.elsewhere or sequence

    @property
    def text(self) -> str:
        """All of it but the place, in one line."""
        return f"{self.problem}. {self.advice} [{self.rule}]"
