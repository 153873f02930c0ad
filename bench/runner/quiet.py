"""Nobody watches: for runs started by programs."""

from __future__ import annotations

from pathlib import Path

from bench.clock import Clock
from bench.engine.questions import Question
from bench.quality import Judged
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep


class Quiet:
    """An observer that shows nothing and keeps the notices."""

    def __init__(self) -> None:
        self.notices: list[str] = []

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Nothing to show."""

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Nothing to show."""

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Nothing to show."""

    def reading(self, name: str, reading: Judged) -> None:
        """Nothing to show."""

    def asked(self, question: Question) -> None:
        """Nobody to show it to."""

    def held(self, by: str) -> None:
        """Nothing to show."""

    def notice(self, text: str) -> None:
        """Kept."""
        self.notices.append(text)
