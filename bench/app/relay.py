"""Observer interface of a run, and an observer that forwards to another."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from bench.clock import Clock
from bench.engine.engine import Observer
from bench.engine.questions import Question
from bench.quality import Judged
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep


class RunObserver(Observer, Protocol):
    """Display of a run, from the creation of its directory to its results."""

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Called when the directory exists; `clock` is that of the bench."""

    def reading(self, name: str, reading: Judged) -> None:
        """Called with a new reading of a channel."""


class Relay:
    """Observer that forwards everything to another one."""

    def __init__(self, observer: RunObserver) -> None:
        self._observer = observer

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Forward."""
        self._observer.run_begins(path, expected, clock)

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Forward."""
        self._observer.step_begins(planned, index)

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """Forward."""
        self._observer.step_ended(planned, index)

    def reading(self, name: str, reading: Judged) -> None:
        """Forward."""
        self._observer.reading(name, reading)

    def asked(self, question: Question) -> None:
        """Forward."""
        self._observer.asked(question)

    def held(self, by: str) -> None:
        """Forward."""
        self._observer.held(by)

    def notice(self, text: str) -> None:
        """Forward."""
        self._observer.notice(text)
