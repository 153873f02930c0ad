"""A plan against a bench: everything that can be known before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, assert_never

from pydantic import ValidationError

from bench.config.devices import DeviceEntry
from bench.config.document import Place, Problem
from bench.config.load import problems
from bench.config.models import BenchFile
from bench.sequence.methods import known_methods
from bench.sequence.model import LimitEntry
from bench.sequence.plan import Plan
from bench.sequence.steps import NEEDS, Acquire, Move, Note, Ramp, SetOutput, Soak, Step, Wait, WaitUntil, verb_of
from drivers.capabilities import THERMOMETER
from drivers.suggest import did_you_mean
from drivers.units import QuantityError, quoted


def check(plan: Plan, bench: BenchFile | None) -> Iterator[Problem]:
    """What is wrong with a plan: by itself, and on a bench where one is given."""
    if bench is not None:
        yield from _needs(plan, bench)
    yield from _steps(plan, bench)
    yield from _results(plan)


def _needs(plan: Plan, bench: BenchFile) -> Iterator[Problem]:
    for role, kind in plan.sequence.needs.items():
        place: Place = ("needs", role)
        if kind == THERMOMETER:
            if role not in bench.readings:
                yield place, f"the bench '{bench.title}' has no reading '{role}'{did_you_mean(role, bench.readings)}"
        elif role not in bench.devices:
            yield place, f"the bench '{bench.title}' has no device '{role}'{did_you_mean(role, bench.devices)}"
        elif kind not in bench.devices[role].description.capabilities:
            is_a = ", ".join(sorted(bench.devices[role].description.capabilities))
            yield place, f"the sequence needs a {kind}, '{role}' of the bench is a {is_a}"


def _steps(plan: Plan, bench: BenchFile | None) -> Iterator[Problem]:
    """Problems of steps; one that comes back in every pass of a loop is told once, with the first step that has it."""
    told: set[Place] = set()
    for planned in plan:
        found = list(_role(plan, planned.step))
        if not found and bench is not None and _is_there(plan, planned.step, bench):
            found = [(key, f"{key}: {problem} (step {planned.id})") for key, problem in _limits(planned.step, bench)]
        for key, problem in found:
            place: Place = (*planned.place, key)
            if place not in told:
                told.add(place)
                yield place, problem


def _role(plan: Plan, step: Step) -> Iterator[tuple[str, str]]:
    """A role that the sequence does not need, or that cannot do what the step says: the key, and what is wrong."""
    if isinstance(step, (Wait, Note)):
        return
    verb, needs = verb_of(step), plan.sequence.needs
    kind = needs.get(step.role)
    if kind is None:
        yield verb, f"'{step.role}' is not among the needs of the sequence{did_you_mean(step.role, needs)}"
    elif kind not in NEEDS[verb]:
        yield verb, f"'{verb}' needs a {' or '.join(NEEDS[verb])}, '{step.role}' is a {kind}"
    elif isinstance(step, SetOutput):
        if kind == "power_supply" and step.current_a is not None:
            yield "current", f"'{step.role}' is a power_supply, which takes voltage and current_limit"
        if kind == "current_source" and step.voltage_v is not None:
            yield "voltage", f"'{step.role}' is a current_source, which takes current and compliance"


def _is_there(plan: Plan, step: Step, bench: BenchFile) -> bool:
    """Whether the bench has what the step acts on; what it lacks is told with the needs."""
    if isinstance(step, (Wait, Note, Soak, WaitUntil)):
        return True
    device = bench.devices.get(step.role)
    return device is not None and plan.sequence.needs[step.role] in device.description.capabilities


def _limits(step: Step, bench: BenchFile) -> Iterator[tuple[str, str]]:
    """Values beyond what the bench file allows: the key, and what is wrong."""
    match step:
        case Move():
            yield from _move(step, bench.devices[step.role])
        case Ramp():
            chamber = bench.devices[step.role]
            yield from _beyond(chamber, step.role, "to", "temperature", step.temperature_c, "°C")
            yield from _beyond(chamber, step.role, "at", "ramp_rate", step.rate_c_per_min, "°C/min")
        case SetOutput():
            yield from _output(step, bench.devices[step.role])
        case Soak():
            if step.give_up_after_s is not None and step.give_up_after_s < step.least_s:
                yield "give_up_after", "is shorter than the soak itself"
        case Acquire() | Wait() | WaitUntil() | Note():
            pass
        case _:
            assert_never(step)


def _move(step: Move, head: DeviceEntry) -> Iterator[tuple[str, str]]:
    target = list(_beyond(head, step.role, "to", "angle", step.angle_deg, "°"))
    yield from target
    if not target and step.approach != "direct":
        distance_deg = getattr(head.options, "approach_distance", 0.0)
        start_deg = step.angle_deg + (distance_deg if step.approach == "from_above" else -distance_deg)
        for key, problem in _beyond(head, step.role, "approach", "angle", start_deg, "°"):
            yield key, f"begins where {problem}"


def _output(step: SetOutput, source: DeviceEntry) -> Iterator[tuple[str, str]]:
    for key, limit, value, unit in (
        ("voltage", "voltage", step.voltage_v, "V"),
        ("current_limit", "current", step.current_limit_a, "A"),
        ("current", "current", step.current_a, "A"),
    ):
        if value is not None:
            yield from _beyond(source, step.role, key, limit, value, unit)
    most_v = getattr(source.options, "compliance", None)
    if step.compliance_v is not None and most_v is not None and step.compliance_v > most_v:
        yield "compliance", _outside(step.compliance_v, "above", most_v, "V", step.role)


def _beyond(device: DeviceEntry, role: str, key: str, limit: str, value: float, unit: str) -> Iterator[tuple[str, str]]:
    """A problem when a value is outside the bench file's limit of that name."""
    allowed: Any = getattr(device.limits, limit, None)
    low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
    if low is not None and value < low:
        yield key, _outside(value, "below", low, unit, role)
    if high is not None and value > high:
        yield key, _outside(value, "above", high, unit, role)


def _outside(value: float, where: str, limit: float, unit: str, role: str) -> str:
    return f"{value:.12g} {unit} is {where} the {limit:.12g} {unit} that the bench file allows '{role}'"


def _results(plan: Plan) -> Iterator[Problem]:
    labels = set(_labels([plan.document.value.get(phase) for phase in ("setup", "steps", "teardown")]))
    for index, entry in enumerate(plan.sequence.results):
        place: Place = ("results", index)
        if entry.data not in labels and None not in labels:
            hint = did_you_mean(entry.data, sorted(filter(None, labels)))
            yield (*place, "data"), f"no step acquires with the label '{entry.data}'{hint}"
        method = known_methods().get(entry.method)
        if method is None:
            hint = did_you_mean(entry.method, known_methods())
            yield (*place, "method"), f"there is no method {quoted(entry.method)}{hint}"
            continue
        try:
            method.settings.model_validate(entry.settings)
        except ValidationError as error:
            yield from problems(plan.document.value, error, (*place, "settings"))
        for name, limit in entry.limits.items():
            if problem := _limit_problem(name, limit, entry.method):
                yield (*place, "limits", name), problem


def _labels(blocks: Any) -> Iterator[str | None]:
    """The labels of all acquisitions, also of steps that are wrong; None where one cannot be told."""
    for block in blocks if isinstance(blocks, list) else ():
        if isinstance(block, list):
            yield from _labels(block)
        elif isinstance(block, dict):
            if "acquire" in block:
                label = block.get("label")
                yield label if isinstance(label, str) else None
            yield from _labels(block.get("steps"))


def _limit_problem(name: str, limit: LimitEntry, method: str) -> str:
    quantities = known_methods()[method].quantities
    if name not in quantities:
        return f"{method} has no result {quoted(name)}{did_you_mean(name, quantities)}"
    try:
        low, high = limits_in(limit, quantities[name])
    except QuantityError as problem:
        return f"{name} {problem}"
    return f"{name}: min is above max" if low is not None and high is not None and low > high else ""


def limits_in(limit: LimitEntry, unit: str) -> tuple[float | None, float | None]:
    """Both limits as numbers in `unit`; QuantityError when they are in another."""
    low, high = (None if side is None else side.to(unit) for side in (limit.min, limit.max))
    return low, high
