"""Rules on the combination of steps in a plan: simultaneous, consecutive, or never reached."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.config.document import Document, Place
from bench.config.models import BenchFile
from bench.sequence.checks.remarks import Found
from bench.sequence.document.model import PHASES
from bench.sequence.estimate.settling import PEAK_TO_PEAK_SD
from bench.sequence.language.expressions import ValueProblem, names_in
from bench.sequence.language.readings import is_pulse_rate, measured_place
from bench.sequence.language.values import holds_expression, value_of
from bench.sequence.plan.plan import Branches, Nodes, Plan, PlannedStep, leaves, within
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.waits import Soak, WaitUntil


def shared_device(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A device that two parallel branches use."""
    for branches in _parallel((*plan.setup, *plan.steps, *plan.teardown)):
        owners: dict[str, str] = {}
        for name, nodes in branches.branches.items():
            for role, planned in _used(nodes, bench).items():
                if owners.setdefault(role, name) != name:
                    yield (
                        planned.place,
                        f"'{role}' is used here in branch '{name}', and in branch '{owners[role]}' at the same time",
                        "Put both into one branch, or run them one after the other",
                    )


def _parallel(nodes: Nodes) -> Iterator[Branches]:
    for node in nodes:
        if isinstance(node, Branches):
            yield node
        for inner in within(node):
            yield from _parallel(inner)


def _used(nodes: Nodes, bench: BenchFile) -> dict[str, PlannedStep]:
    """Devices that steps act on, each with its first step; readings may be shared."""
    used: dict[str, PlannedStep] = {}
    for planned in leaves(nodes):
        if isinstance(planned.step, Orient):
            used = {**dict.fromkeys(bench.axes, planned), **used}
        for key in ("role", "of"):
            role = getattr(planned.step, key, None)
            if role is None:
                continue
            named = bench.acquired_from if isinstance(planned.step, Acquire) else bench.members
            for member in named(role):
                if member in bench.devices:
                    used.setdefault(member, planned)
        reading = getattr(planned.step, "reading", "")
        if isinstance(planned.step, WaitUntil) and planned.step.steady is not None:
            used = {**dict.fromkeys(bench.acquired_from(reading.partition(".")[0]), planned), **used}
        elif is_pulse_rate(reading, bench) or reading in bench.devices:
            used.setdefault(reading.partition(".")[0], planned)
        if (place := measured_place(reading, bench)) is not None:
            used.setdefault(bench.measured_by(place), planned)
    return used


def unreachable(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """Steps behind a condition that is never true."""
    for place, block in _ifs(plan.document, ()):
        condition = _constant(block["if"])
        if condition is None:
            continue
        never = "else" if condition else "then"
        if block.get(never):
            yield (
                (*place, never),
                f"the condition is always {str(condition).lower()}, so that these steps never run",
                "Write a condition over a parameter or a measurement, or remove these steps",
            )


def _ifs(document: Document, outer: Place) -> Iterator[tuple[Place, dict[str, Any]]]:
    """Every `if` of a document and of those it calls, with its place."""
    for phase in PHASES:
        yield from _ifs_in(document.value.get(phase), (*outer, phase))
    for place, called in document.included.items():
        yield from _ifs(called, (*outer, *place))


def _ifs_in(raw: Any, place: Place) -> Iterator[tuple[Place, dict[str, Any]]]:
    if isinstance(raw, dict):
        if "if" in raw:
            yield place, raw
        for key, value in raw.items():
            yield from _ifs_in(value, (*place, key))
    elif isinstance(raw, list):
        for index, value in enumerate(raw):
            yield from _ifs_in(value, (*place, index))


def _constant(raw: Any) -> bool | None:
    """Value of a condition without names; None for one with names."""
    if holds_expression(raw) and names_in(raw[2:-1]):
        return None
    try:
        value = value_of(raw)
    except ValueProblem:
        return None
    return value if isinstance(value, bool) else None


def soak_never_stable(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A band narrower than the noise of the simulated thermometer at a unit."""
    span_c = PEAK_TO_PEAK_SD * bench.simulation.thermometer.noise
    at_units = {reading for unit in bench.places.values() for reading in unit.read.values()}
    for planned in plan if bench.is_simulated else ():
        step = planned.step
        if not isinstance(step, Soak) or not step.until_stable or at_units.isdisjoint(bench.members(step.role)):
            continue
        if step.until_stable.band_c < span_c:
            yield (
                (*planned.place, "until_stable", "band"),
                f"the noise of '{step.role}' alone spans about {span_c:g} °C, so that a band of "
                f"{step.until_stable.band_c:g} °C is never held",
                f"Give a band above {span_c:g} °C, or lower simulation.thermometer.noise of the bench file",
            )
