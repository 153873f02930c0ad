"""A plan against a bench: everything that can be known before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, assert_never

from pydantic import ValidationError

from bench.config.load import problems
from bench.config.models import BenchFile, DeviceEntry
from bench.errors import InputError
from bench.sequence.methods import known_methods
from bench.sequence.model import LimitEntry, ResultEntry
from bench.sequence.plan import Plan
from bench.sequence.steps import NEEDS, Acquire, Move, Ramp, SetOutput, Soak, Step, Wait, verb_of
from drivers.capabilities import THERMOMETER
from drivers.quantities import Quantity, QuantityError
from drivers.suggest import did_you_mean


def check(plan: Plan, bench: BenchFile) -> None:
    """InputError lists every problem, each with its place, once."""
    found = [*_needs(plan, bench), *_steps(plan, bench), *_results(plan)]
    if found:
        raise InputError(*dict.fromkeys(found))


def _needs(plan: Plan, bench: BenchFile) -> Iterator[str]:
    for role, kind in plan.sequence.needs.items():
        where = plan.document.where(("needs", role))
        if kind == THERMOMETER:
            if role not in bench.readings:
                yield f"{where}: the bench '{bench.title}' has no reading '{role}'{did_you_mean(role, bench.readings)}"
        elif role not in bench.devices:
            yield f"{where}: the bench '{bench.title}' has no device '{role}'{did_you_mean(role, bench.devices)}"
        elif kind not in bench.devices[role].description.capabilities:
            is_a = ", ".join(sorted(bench.devices[role].description.capabilities))
            yield f"{where}: the sequence needs a {kind}, '{role}' of the bench is a {is_a}"


def _steps(plan: Plan, bench: BenchFile) -> Iterator[str]:
    for planned in plan:
        role = getattr(planned.step, "role", None)
        if role is not None:
            verb = verb_of(planned.step)
            kind = plan.sequence.needs.get(role)
            where = plan.document.where((*planned.place, verb))
            if kind is None:
                hint = did_you_mean(role, plan.sequence.needs)
                yield f"{where}: '{role}' is not among the needs of the sequence{hint}"
                continue
            if kind not in NEEDS[verb]:
                yield f"{where}: '{verb}' needs a {' or '.join(NEEDS[verb])}, '{role}' is a {kind}"
                continue
            if role not in bench.devices and role not in bench.readings:
                continue  # told by the needs
        for key, problem in _limits(planned.step, bench):
            yield f"{plan.document.where((*planned.place, key))}: {key}: {problem} (step {planned.id})"


def _limits(step: Step, bench: BenchFile) -> Iterator[tuple[str, str]]:
    """Values beyond what the bench file allows: the key, and what is wrong."""
    match step:
        case Move():
            head = bench.devices[step.role]
            yield from _beyond(head, step.role, "to", "angle", step.angle_deg, "°")
            overshoot = getattr(head.options, "approach_distance", 0.0)
            start = {"from_below": -overshoot, "from_above": overshoot, "direct": 0.0}[step.approach]
            for key, problem in _beyond(head, step.role, "approach", "angle", step.angle_deg + start, "°"):
                yield key, f"the approach starts where {problem}"
        case Ramp():
            chamber = bench.devices[step.role]
            yield from _beyond(chamber, step.role, "to", "temperature", step.temperature_c, "°C")
            yield from _beyond(chamber, step.role, "at", "ramp_rate", step.rate_c_per_min, "°C/min")
        case SetOutput():
            source = bench.devices[step.role]
            for key, name, value, unit in (
                ("voltage", "voltage", step.voltage_v, "V"),
                ("current_limit", "current", step.current_limit_a, "A"),
                ("current", "current", step.current_a, "A"),
            ):
                if value is not None:
                    yield from _beyond(source, step.role, key, name, value, unit)
        case Soak():
            hold_s = step.until_stable.hold_s if step.until_stable else 0.0
            if step.give_up_after_s is not None and step.give_up_after_s < max(step.at_least_s, hold_s):
                yield "give_up_after", "is shorter than the soak itself"
        case Acquire() | Wait():
            pass
        case _:
            assert_never(step)


def _beyond(device: DeviceEntry, role: str, key: str, limit: str, value: float, unit: str) -> Iterator[tuple[str, str]]:
    """A problem when a value is outside the bench file's limit of that name."""
    allowed: Any = getattr(device.limits, limit, None)
    low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
    if low is not None and value < low:
        yield key, f"{value:g} {unit} is below the {low:g} {unit} that the bench file allows '{role}'"
    if high is not None and value > high:
        yield key, f"{value:g} {unit} is above the {high:g} {unit} that the bench file allows '{role}'"


def _results(plan: Plan) -> Iterator[str]:
    labels = {planned.step.label for planned in plan if isinstance(planned.step, Acquire)}
    for index, entry in enumerate(plan.sequence.results):
        place = ("results", index)
        if entry.data not in labels:
            hint = did_you_mean(entry.data, sorted(labels))
            yield f"{plan.document.where((*place, 'data'))}: no step acquires with the label '{entry.data}'{hint}"
        method = known_methods().get(entry.method)
        if method is None:
            hint = did_you_mean(entry.method, known_methods())
            yield f"{plan.document.where((*place, 'method'))}: there is no method '{entry.method}'{hint}"
            continue
        try:
            method.settings.model_validate(entry.settings)
        except ValidationError as error:
            yield from problems(plan.document, error.errors(include_url=False), (*place, "settings"))
        yield from _limit_entries(plan, entry, index)


def _limit_entries(plan: Plan, entry: ResultEntry, index: int) -> Iterator[str]:
    quantities = known_methods()[entry.method].quantities
    for name, limit in entry.limits.items():
        where = plan.document.where(("results", index, "limits", name))
        if name not in quantities:
            yield f"{where}: {entry.method} has no result '{name}'{did_you_mean(name, quantities)}"
            continue
        try:
            low, high = limits_in(limit, quantities[name])
        except QuantityError as problem:
            yield f"{where}: {name} {problem}"
            continue
        if low is not None and high is not None and low > high:
            yield f"{where}: {name}: min is above max"


def limits_in(limit: LimitEntry, unit: str) -> tuple[float | None, float | None]:
    """Both limits as numbers in `unit`; QuantityError when they are in another."""
    low, high = (side.to(unit) if isinstance(side, Quantity) else None for side in (limit.min, limit.max))
    return low, high
