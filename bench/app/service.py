"""Observer of a run under systemd: notifies readiness and the current step."""

from __future__ import annotations

from pathlib import Path

from bench.app.relay import Relay
from bench.clock import Clock
from bench.runner.notify import notify
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep


class Service(Relay):
    """Observer that forwards to another one and notifies the service manager."""

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """Report readiness."""
        notify("READY=1", f"STATUS={path.name} begins")
        super().run_begins(path, expected, clock)

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """Report the step."""
        notify(f"STATUS=step {index + 1}: {planned.id}")
        super().step_begins(planned, index)

    def held(self, by: str) -> None:
        """Report the holder of the run."""
        if by:
            notify(f"STATUS=held by {by}")
        super().held(by)
