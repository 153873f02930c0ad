"""Observer without display, for runs started by programs."""

from __future__ import annotations

from pathlib import Path

from bench.clock import Clock
from bench.engine.questions import Question
from bench.quality import Judged
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep


class Quiet:
    """Observer that shows nothing and keeps the notices."""

    def __init__(self) -> None:
        self.notices: list[str] = []

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Do nothing."""

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Do nothing."""

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Do nothing."""

    def reading(self, name: str, reading: Judged) -> None:
        """Do nothing."""

    def asked(self, question: Question) -> None:
        """Do nothing."""

    def held(self, by: str) -> None:
        """Do nothing."""

    def notice(self, text: str) -> None:
        """Keep the notice."""
        self.notices.append(text)
