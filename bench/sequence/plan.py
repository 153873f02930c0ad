"""A plan: every step of a run, in order, with its values and a stable id. Data; it can be listed, counted, checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from bench.config.document import Document, Place
from bench.sequence.expressions import Value
from bench.sequence.model import Outline
from bench.sequence.steps import Step

Phase = Literal["setup", "steps", "teardown"]


@dataclass(frozen=True)
class PlannedStep:
    """One step of a run.

    `id` names it by its loops (`steps/temperature=-40/position=90#2/acquire`; `#n` marks the n-th visit of the same
    value). `loops` holds the variables around it, outermost first; `place` is where it stands in the document.
    """

    id: str
    phase: Phase
    step: Step
    loops: Mapping[str, Value]
    place: Place


@dataclass(frozen=True)
class Plan:
    """A sequence with its parameters chosen and its loops unrolled."""

    document: Document
    sequence: Outline
    parameters: Mapping[str, Value]
    preset: str | None
    setup: tuple[PlannedStep, ...]
    steps: tuple[PlannedStep, ...]
    teardown: tuple[PlannedStep, ...]

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.document.path.stem

    def __iter__(self) -> Iterator[PlannedStep]:
        yield from self.setup
        yield from self.steps
        yield from self.teardown

    def __len__(self) -> int:
        return len(self.setup) + len(self.steps) + len(self.teardown)

    def where(self, step: PlannedStep) -> str:
        """`file:line:column` of a step."""
        return self.document.where(step.place)
