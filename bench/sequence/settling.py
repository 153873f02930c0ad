"""How long a unit takes to have the temperature of its chamber, as far as a bench file lets it be known."""

from __future__ import annotations

from bench.config.models import BenchFile
from bench.sequence.waits import Soak, WaitUntil


class Settling:
    """The chamber's course so far, and when a unit in it has settled."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench

    def ramp(self, from_c: float, to_c: float, at_s: float, duration_s: float) -> None:
        """The set point goes from one temperature to another."""

    def soak_s(self, step: Soak, at_s: float) -> float:
        """How long a soak that begins at `at_s` takes."""
        return step.least_s

    def wait_s(self, step: WaitUntil, at_s: float) -> float:
        """How long a reading takes to fulfil a condition."""
        return step.least_s
