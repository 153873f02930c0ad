"""The observer of a run that is a service of systemd: ready when the run begins, then the step that it is at."""

from __future__ import annotations

from pathlib import Path

from bench.app.relay import Relay
from bench.clock import Clock
from bench.runner.notify import notify
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.plan import PlannedStep


class Service(Relay):
    """Passes everything on to another observer, with a notification to the service manager."""

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        """The run is ready."""
        notify("READY=1", f"STATUS={path.name} begins")
        super().run_begins(path, expected, clock)

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """The step is the status."""
        notify(f"STATUS=step {index + 1}: {planned.id}")
        super().step_begins(planned, index)

    def held(self, by: str) -> None:
        """Who holds the run is the status."""
        if by:
            notify(f"STATUS=held by {by}")
        super().held(by)
