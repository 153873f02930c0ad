"""Orders of manual control: one step of a sequence, checked against the bench as the steps of a plan are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bench.config.document import parse_document
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.sequence.checks.steps import is_there, limit_problems, role_problems
from bench.sequence.language.values import holds_expression
from bench.sequence.steps.measuring import Measure
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.steps.verbs import NEEDS, STEPS
from drivers.capabilities import READING
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import error_text

Order = Move | Rotate | Oscillate | SetOutput | Ramp | Measure
# Keys of each order beside its verb; all of them describe a single action with an end.
KEYS: Mapping[str, frozenset[str]] = {
    "move": frozenset({"to", "by", "way", "approach", "settle"}),
    "rotate": frozenset({"at", "acceleration", "turns", "for"}),
    "oscillate": frozenset({"amplitude", "frequency", "for"}),
    "set": frozenset({"voltage", "current_limit", "current", "acceleration", "place", "compliance", "output"}),
    "ramp": frozenset({"to", "at"}),
    "measure": frozenset({"for"}),
}


def order_of(text: str, bench: BenchFile) -> Order:
    """Return the step of an order, such as `{move: head, to: 90 °}`; roles are checked, limits are not.

    Raises InputError with all problems.
    """
    raw = parse_document(text, Path("order")).value
    if not isinstance(raw, dict) or not raw:
        raise InputError("an order is one step of a sequence, such as {move: head, to: 90 °}")
    verb = next(iter(raw))
    if verb not in KEYS:
        raise InputError(f"'{verb}' is no order{did_you_mean(str(verb), KEYS)}; expected one of {', '.join(KEYS)}")
    if wrong := [key for key in raw if key != verb and key not in KEYS[verb]]:
        raise InputError(f"'{wrong[0]}' is no key of an order '{verb}'{did_you_mean(str(wrong[0]), KEYS[verb])}")
    if any(holds_expression(value) for value in raw.values()):
        raise InputError("an order has no expressions; write the value")
    step = _validated(verb, {**raw, "as": "measured"} if verb == "measure" else raw)
    if problems := [f"{key}: {problem}" for key, problem in role_problems(step, _needs(verb, bench), bench)]:
        raise InputError(*problems)
    return step


def beyond_limits(step: Order, bench: BenchFile, from_deg: float) -> list[str]:
    """Return why the bench file forbids an order; a motion begins at `from_deg`."""
    if not is_there(step, _needs("", bench), bench):
        return ["the bench has no such device"]
    return [f"{key}: {problem}" for key, problem in limit_problems(step, bench, from_deg)]


def devices_of(step: Order, bench: BenchFile) -> tuple[str, ...]:
    """Return the devices that an order moves or energises; none for a measurement."""
    return () if isinstance(step, Measure) else bench.members(step.role)


def _validated(verb: str, raw: Mapping[str, Any]) -> Order:
    try:
        step: Any = STEPS[verb].model_validate(raw, context={"files_needed": False})
    except ValidationError as error:
        found = error.errors(include_url=False)
        raise InputError(*(f"{'.'.join(map(str, each['loc']))} {error_text(each)}".strip() for each in found)) from None
    order: Order = step
    return order


def _needs(verb: str, bench: BenchFile) -> dict[str, str]:
    """Return all devices, groups and readings of a bench as needs, each device as what the verb needs if it can."""
    needs = dict.fromkeys(bench.readings, READING)
    for name in (*bench.devices, *bench.together):
        if (device := bench.devices.get(bench.members(name)[0])) is not None:
            able = device.description.capabilities
            needs[name] = next((kind for kind in NEEDS.get(verb, ()) if kind in able), min(able))
    return needs
