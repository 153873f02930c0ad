"""Results of a plan by method, and the acquisitions that they are computed from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from bench.config.document import Place
from bench.config.models import BenchFile
from bench.sequence.document.model import ResultEntry
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.steps.fields import is_known
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Ramp
from bench.sequence.steps.waits import Steady
from drivers.quantity.units import QuantityError

Found = Iterator[tuple[str, str]]  # (key with the problem, problem)


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


def steady_problems(steady: Steady, places: Iterable[str], bench: BenchFile) -> Found:
    """Reasons why the outputs of units cannot be checked against a stability criterion."""
    for name in places:
        if bench.places[name].channels is not None:
            yield "wait_until", f"'steady' is for units with one channel; place '{name}' is for an inertial unit"
        elif is_known(steady.change) and not steady.in_g:
            try:
                steady.change.to(bench.output_unit(name))
            except QuantityError as problem:
                yield "steady", str(problem)
        elif is_known(steady.change):
            yield from without_nominal("steady", (name,), bench)


def without_nominal(key: str, places: Iterable[str], bench: BenchFile) -> Found:
    """Units without a nominal output at 1 g in the bench file, where a step needs one."""
    for name in places:
        if bench.nominal_per_g(name) is None:
            parts = bench.places[name].output_per_g_keys
            makes = "which makes it of g" if len(parts) == 1 else "which make it of g"
            yield key, f"places.{name} of the bench file has no nominal {' and '.join(parts)}, {makes}"
