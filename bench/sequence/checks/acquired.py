"""Results of a plan by method, and the acquisitions that they are computed from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from bench.config.document import Place
from bench.sequence.document.model import ResultEntry
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Ramp


def results_by(plan: Plan, *methods: str) -> Iterator[tuple[Place, ResultEntry]]:
    """Yield the results of these methods, each with its place in the document."""
    for index, entry in enumerate(plan.sequence.results):
        if entry.method in methods:
            yield ("results", index), entry


def acquired_under(plan: Plan, label: str) -> list[str]:
    """Return the ids of the acquisitions with a label."""
    return [planned.id for planned in plan if isinstance(planned.step, Acquire) and planned.step.label == label]


def ramps_during(steps: Iterable[PlannedStep], label: str) -> Iterator[tuple[PlannedStep, Ramp, float]]:
    """Yield each ramp during an acquisition with a label, with its initial set point in °C, NaN for the first ramp."""
    acquiring, set_c = "", math.nan
    for planned in steps:
        match planned.step:
            case Acquire():
                acquiring = planned.id if planned.step.label == label else ""
            case Ramp():
                if acquiring and planned.id.startswith(f"{acquiring}/"):
                    yield planned, planned.step, set_c
                set_c = planned.step.temperature_c
