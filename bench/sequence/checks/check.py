"""Check of a plan against a bench: everything that can be known before anything moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bench.config.checks_interlocks import interlock_misfits
from bench.config.document import Document, Place, Problem
from bench.config.load import problems
from bench.config.models import BenchFile
from bench.sequence.checks.steps import is_there, limit_problems, role_problems
from bench.sequence.document.model import PHASES, ResultEntry
from bench.sequence.language.readings import unit_of
from bench.sequence.language.values import contains_expression
from bench.sequence.method import OUTPUT_UNITS, MethodDescription, known_methods
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import angles_before
from bench.sequence.plan.subsequences import declared_at
from bench.sequence.steps.limits import ratio_problem, unit_problems
from drivers.capabilities import OUTPUT, READING, THERMOMETER
from drivers.quantity.units import quoted
from drivers.schema.suggest import did_you_mean


def check(plan: Plan, bench: BenchFile | None) -> Iterator[Problem]:
    """Problems of a plan by itself and, if a bench is given, on that bench."""
    if bench is not None:
        yield from unmet_needs(plan, bench)
        yield from interlocks(plan, bench)
    yield from _steps(plan, bench)
    yield from _results(plan, bench)


def unmet_needs(plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    """Yield the needs of a plan that a bench does not meet."""
    for role, kind in plan.sequence.needs.items():
        place = declared_at(plan.document, "needs", role)
        if kind in (THERMOMETER, READING):
            if bench.members(role)[0] not in bench.readings:
                yield place, f"the bench '{bench.title}' has no reading '{role}'{did_you_mean(role, bench.readings)}"
            elif kind == THERMOMETER and (unit := unit_of(role, bench)) != "°C":
                yield place, f"the sequence needs a thermometer, '{role}' of the bench is in {unit}"
        elif kind == OUTPUT:
            if role in bench.devices:
                yield place, f"'{role}' is a device of the bench; choose another name for the output of the units"
        elif (device := bench.devices.get(bench.members(role)[0])) is None:
            yield place, f"the bench '{bench.title}' has no device '{role}'{did_you_mean(role, bench.devices)}"
        elif kind not in device.description.capabilities:
            is_a = ", ".join(sorted(device.description.capabilities))
            yield place, f"the sequence needs a {kind}, '{role}' of the bench is a {is_a}"


def _steps(plan: Plan, bench: BenchFile | None) -> Iterator[Problem]:
    """Problems of steps; one that recurs in every pass of a loop is reported once, with its first step.

    The same holds for a sequence that is called repeatedly.
    """
    reported: set[tuple[Path, Place]] = set()
    needs = plan.sequence.needs
    seen: set[tuple[Place, int, float]] = set()  # the same step from the same angle has the same problems in every pass
    for planned, from_deg in angles_before(plan, bench):
        if (once := (planned.place, id(planned.step), from_deg)) in seen:
            continue
        seen.add(once)
        found = list(role_problems(planned.step, needs, bench))
        if not found and bench is not None and is_there(planned.step, needs, bench):
            found = [
                (key, f"{key}: {problem} (step {planned.id})")
                for key, problem in limit_problems(planned.step, bench, from_deg)
            ]
        for key, problem in found:
            place: Place = (*planned.place, key)
            owner, inner = plan.document.owner(place)
            if (owner.path, inner) not in reported:
                reported.add((owner.path, inner))
                yield place, problem


def _results(plan: Plan, bench: BenchFile | None) -> Iterator[Problem]:
    labels = set(_labels(plan.document))
    for index, entry in enumerate(plan.sequence.results):
        place: Place = ("results", index)
        for key, label in (("data", entry.data), ("closure", entry.closure)):
            if label is not None and label not in labels and None not in labels:
                hint = did_you_mean(label, sorted(filter(None, labels)))
                yield (*place, key), f"no step acquires with the label '{label}'{hint}"
        method = known_methods().get(entry.method)
        if method is None:
            hint = did_you_mean(entry.method, known_methods())
            yield (*place, "method"), f"there is no method {quoted(entry.method)}{hint}"
            continue
        if entry.closure is not None and not method.closes:
            yield (*place, "closure"), f"{entry.method} has no stability check; remove 'closure'"
        yield from _settings(entry, method, plan.document.value, (*place, "settings"))
        yield from _result_limits(entry, method, bench, (*place, "limits"))
        yield from _drifts(entry, method, bench, (*place, "monthly_drift"))


def _settings(entry: ResultEntry, method: MethodDescription, written: Any, place: Place) -> Iterator[Problem]:
    """Problems of settings, except of those with an expression that could not be evaluated, which is reported."""
    try:
        method.settings.model_validate(entry.settings)
    except ValidationError as error:
        for at, problem in problems(written, error, place):
            value = reduce(lambda part, key: part[key], at[len(place) :], entry.settings)
            if at == place or not contains_expression(value):
                yield at, problem


def _result_limits(
    entry: ResultEntry, method: MethodDescription, bench: BenchFile | None, place: Place
) -> Iterator[Problem]:
    """Problems of limits on results that the method does not have, or in another unit than the method gives.

    Without a bench the unit of any output is accepted, as long as all keys of a limit agree.
    """
    for name, limit in entry.limits.items():
        if name not in method.quantities:
            yield (*place, name), _no_result(name, method)
            continue
        found = [list(unit_problems(limit, units[name])) for units in _units(method, bench)]
        wrong = max(found, key=len) if bench else min(found, key=len)
        yield from (((*place, name, key), problem) for key, problem in wrong)


def _drifts(entry: ResultEntry, method: MethodDescription, bench: BenchFile | None, place: Place) -> Iterator[Problem]:
    """Problems of specified drifts, as of limits."""
    for name, value in entry.monthly_drift.items():
        if name not in method.quantities:
            yield (*place, name), _no_result(name, method)
            continue
        found = [ratio_problem(value, units[name]) for units in _units(method, bench)]
        if wrong := max(found, key=len) if bench else min(found, key=len):
            yield (*place, name), wrong


def _units(method: MethodDescription, bench: BenchFile | None) -> list[Mapping[str, str]]:
    """Units of the results for each kind of unit on a bench; without one, for every output that there is."""
    if bench is None or not bench.places:
        return [method.units(unit) for unit in OUTPUT_UNITS]
    on_bench = {
        (bench.output_unit(place), bench.gyro_output_unit(place), bench.circuit_unit(place) or "")
        for place in bench.places
    }
    return [method.units(*each) for each in sorted(on_bench)]


def _no_result(name: str, method: MethodDescription) -> str:
    return f"{method.name} has no result {quoted(name)}{did_you_mean(name, method.quantities)}"


def _labels(document: Document) -> Iterator[str | None]:
    """Labels of all acquisitions, including those of invalid steps; None if one is unknown."""
    for part in (document, *document.all_included()):
        yield from _labels_in([part.value.get(phase) for phase in PHASES])


def _labels_in(raw: Any) -> Iterator[str | None]:
    if isinstance(raw, dict):
        if "acquire" in raw:
            label = raw.get("label")
            yield label if isinstance(label, str) else None
        raw = list(raw.values())
    if isinstance(raw, list):
        for part in raw:
            yield from _labels_in(part)


def interlocks(plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    """Problems of the interlocks of a sequence on a bench; interlocks of the bench stay in force beside them."""
    declared = plan.sequence.interlocks
    for name in declared:
        if name in bench.interlocks:
            yield (
                declared_at(plan.document, "interlocks", name),
                f"the bench '{bench.title}' has an interlock '{name}', which stays in force; name this one otherwise",
            )
    for (_, misfit, *inner), problem in interlock_misfits(declared, bench):
        yield (*declared_at(plan.document, "interlocks", str(misfit)), *inner), problem
