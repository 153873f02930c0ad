"""Plan of a run, for its timeline and the estimate of its end; made in a worker process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.app.request import RunRequest, load_checked
from bench.app.resume import REQUEST
from bench.errors import InputError
from bench.report.plan_view.timeline import timeline_json
from bench.store.runs import summary

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
    """Return the timeline of a request. Raises InputError."""
    checked = load_checked(request)
    return timeline_json(checked.expected, checked.bench)
