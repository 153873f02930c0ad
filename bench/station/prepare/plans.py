"""Plan of a run, for its timeline and the estimate of its end; made in a worker process."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from bench.app.request import RunRequest, load_checked
from bench.app.resume import REQUEST
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.report.plan_view.timeline import timeline_json
from bench.sequence.steps.verbs import Step, verb_of
from bench.store.runs import summary

_NESTED = ("during",)
_PATHS, _TUPLES = ("parameters", "uut_model", "answers", "scenario"), ("settings", "units", "calibrations")


def timeline_of_run(run: Path) -> dict[str, Any] | None:
    """Return the timeline of a run as `bench plan --json` prints it; None if its files are no longer there."""
    asked = dict(summary(run).manifest.get(REQUEST, {}))
    try:
        asked |= {key: Path(asked[key]) for key in _PATHS if asked.get(key) is not None}
        return timeline_of(RunRequest(**{**asked, **{key: tuple(asked.get(key, ())) for key in _TUPLES}}))
    except (InputError, TypeError):
        return None


def timeline_of(request: RunRequest) -> dict[str, Any]:
    """Return the timeline of a request, with `facts` of each step for sentences. Raises InputError."""
    checked = load_checked(request)
    timeline = timeline_json(checked.expected, checked.bench)
    for step, span in zip(timeline["steps"], checked.expected.spans, strict=True):
        step["facts"] = {"phase": span.step.phase, **facts_of(span.step.step)}
    return timeline | {"limits": _limits(checked.bench), "outputs": checked.bench.output_units}


def facts_of(step: Step) -> dict[str, Any]:
    """Return the verb of a step and its numbers, by the names of its fields; nested steps are left out."""
    fields = {name: getattr(step, name) for name in type(step).model_fields if name not in _NESTED}
    plain = {name: found for name, value in fields.items() if (found := _plain(value)) is not None}
    return {"verb": verb_of(step), **plain}


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return {name: _plain(getattr(value, name)) for name in type(value).model_fields}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _limits(bench: BenchFile) -> dict[str, tuple[float, float]]:
    """Return the permitted ranges of named readings."""
    found = {name: reading.limits for name, reading in bench.readings.items()}
    return {name: (limits.min, limits.max) for name, limits in found.items() if limits is not None}
