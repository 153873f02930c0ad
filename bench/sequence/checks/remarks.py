"""Findings of the rules on a plan as a whole, with severity and place in the document."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from bench.config.document import Document, Place
from bench.config.models import BenchFile
from bench.sequence.plan.plan import Plan

Severity = Literal["error", "warning"]
Found = tuple[Place, str, str]  # (place in the plan, problem, advice)


class Rule(NamedTuple):
    """One rule on a whole plan; `name` is stable, `title` states the property that a plan without remarks has."""

    name: str
    severity: Severity
    title: str
    find: Callable[[Plan, BenchFile], Iterator[Found]]


@dataclass(frozen=True, slots=True)
class Remark:
    """Remark of a rule: a run with an error is refused, a run with a warning is allowed.

    `elsewhere` is the document of `place` if it is not the sequence.
    """

    severity: Severity
    rule: str
    place: Place
    problem: str
    advice: str
    elsewhere: Document | None = field(default=None, compare=False, repr=False)

    def document(self, sequence: Document) -> Document:
        """The document that the remark refers to."""
        return self.elsewhere or sequence

    @property
    def text(self) -> str:
        """Problem, advice and rule in one line, without the place."""
        return f"{self.problem}. {self.advice} [{self.rule}]"
