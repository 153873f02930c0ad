"""What is known of a run before it begins: check, preflight, picture of its plan, rehearsal. For worker processes.

A preflight energises nothing; a rehearsal uses simulated copies of all instruments.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.app.request import CheckedRun, RunRequest
from bench.errors import BenchError, InputError


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class LineView(_Model):
    """Line of a preflight: ok, look (a person should look), NO (not unattended), or - (does not apply)."""

    what: str
    state: str
    text: str


class BeforeRun(_Model):
    """Checks of a submission, before it is queued."""

    expected_s: float = Field(0.0, description="estimated duration in s of bench time")
    size_bytes: float = Field(0.0, description="estimated size of its record")
    steps: int = 0
    simulated: bool = Field(False, description="all instruments are simulated")
    warnings: list[str] = []
    problems: list[str] = Field([], description="they forbid the run")
    preflight: list[LineView] = Field([], description="empty if the check has problems, or it was not asked for")
    preflight_problem: str = Field("", description="why there is no preflight, such as a run in progress")
    unattended_allowed: bool = Field(False, description="the preflight lets the run be unattended")


def before_run(request: RunRequest, *, look: bool = True) -> BeforeRun:
    """Check a request and, if it has no problems and `look`, perform its preflight."""
    from bench.app.preflight import preflight
    from bench.app.request import prepare
    from bench.sequence.checks.output import warning_line

    try:
        prepared = prepare(request)
    except InputError as problem:
        return BeforeRun(problems=list(problem.problems))
    found = BeforeRun(
        expected_s=prepared.expected.total_s, size_bytes=prepared.expected.size_bytes, steps=len(prepared.plan),
        simulated=prepared.loaded.bench.is_simulated,
        warnings=[warning_line(each, prepared.plan.document) for each in prepared.warnings],
    )  # fmt: skip
    if not look:
        return found
    try:
        lines = preflight(prepared)
    except BenchError as problem:
        return found.model_copy(update={"preflight_problem": str(problem)})
    shown = [LineView(what=each.what, state=each.state, text=each.text) for each in lines.lines]
    return found.model_copy(update={"preflight": shown, "unattended_allowed": lines.is_green})


def imported() -> None:
    """Import what checks, pictures and rehearsals need, so that the first of them does not wait for it."""
    import bench.app.preflight
    import bench.app.rehearse
    import bench.report.plan_view.picture  # noqa: F401


def plan_picture(request: RunRequest, lang: str) -> str:
    """Return the picture of a plan as SVG. Raises InputError."""
    from bench.app.request import load_checked

    return picture_of(load_checked(request), lang)


def picture_of(checked: CheckedRun, lang: str) -> str:
    """Return the picture of a checked plan as SVG."""
    from bench.figures.languages import language
    from bench.figures.svg import as_document, drawing
    from bench.report.plan_view.picture import plan_figure

    with language(lang), drawing():
        return as_document(plan_figure(checked.plan, checked.expected, checked.bench))


def rehearsal(request: RunRequest) -> dict[str, Any]:
    """Rehearse a request to its end, as `bench rehearse` does, and note a completed rehearsal for the preflight.

    Raises InputError.
    """
    from bench.app.preflight import rehearsal_key
    from bench.app.rehearse import rehearse
    from bench.app.request import prepare
    from bench.runner.quiet import Quiet
    from bench.store.tried import note_tried

    with tempfile.TemporaryDirectory(prefix="rehearsal-") as folder:
        wanted = request._replace(
            simulate=True, speed="max", runs=Path(folder), operator="rehearsal", past_due="mark", units=(),
            unattended=False, ticket="",
        )  # fmt: skip
        prepared = prepare(wanted)
        found = rehearse(prepared, Quiet())
    how = found.result.outcome.how
    completed = how == "completed" and not found.unsafe and not found.lost
    if completed:
        note_tried("rehearsal", rehearsal_key(prepared))
    return {
        "completed": completed,
        "outcome": how,
        "verdict": found.result.results.verdict if found.result.results else None,
        "planned_s": found.expected.total_s,
        "took_s": found.result.bench_s,
        "problems": [*found.result.problems, *found.lost],
        "unsafe": dict(found.unsafe),
        "differs": [[each.name, each.planned_s, each.took_s] for each in found.largest_deviations(5)],
    }
