"""Rules on names that a sequence declares but does not use."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from bench.config.models import BenchFile
from bench.sequence.checks.remarks import Found
from bench.sequence.document.model import PHASES
from bench.sequence.language.values import holds_expression
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.verbs import Step
from drivers.capabilities import THERMOMETER

_NAME = re.compile(r"[a-z]\w*", re.ASCII)


def unused_parameter(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A parameter that no expression uses."""
    phases = [plan.document.value.get(phase) for phase in (*PHASES, "results")]
    used = {name for expression in _expressions(phases) for name in _NAME.findall(expression)}
    for name in plan.sequence.parameters:
        if name not in used:
            yield (
                ("parameters", name),
                f"no step uses the parameter '{name}'",
                f"Remove it, or write ${{{name}}} where it belongs",
            )


def unused_need(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A role that no step uses; a thermometer for results counts as used."""
    steps = {id(planned.step): planned.step for planned in plan}.values()  # passes of a loop share them
    used = {name for step in steps for name in _mentioned(step)}
    used |= {name.partition(".")[0] for entry in plan.sequence.interlocks.values() for name in entry.names}
    for role, kind in plan.sequence.needs.items():
        if role not in used and not (kind == THERMOMETER and plan.sequence.results):
            yield (
                ("needs", role),
                f"no step uses '{role}', so that benches without a {kind} are refused needlessly",
                "Remove it from the needs",
            )


def _mentioned(step: Step) -> Iterator[str]:
    """Roles and readings that a step names."""
    for key in ("role", "of", "reading"):
        if name := getattr(step, key, None):
            yield name.partition(".")[0]


def _expressions(raw: Any) -> Iterator[str]:
    if isinstance(raw, dict):
        raw = list(raw.values())
    if isinstance(raw, list):
        for part in raw:
            yield from _expressions(part)
    elif holds_expression(raw):
        yield raw
