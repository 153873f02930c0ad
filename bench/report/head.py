"""Head of a report: identification, order, procedure, methods, and conditions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bench.figures.languages import tr
from bench.figures.times_and_sizes import instant
from bench.reduce.journal import Measurement
from bench.reduce.stored_run import StoredRun
from bench.report.page import Facts
from bench.report.revision import Revision
from bench.sequence.method import known_methods


def report_number(manifest: Mapping[str, Any], revision: Revision) -> str:
    """Number of a report: its run, and its revision."""
    return tr("{run}, revision {number}", run=manifest["run"], number=revision.number)


def head(run: StoredRun, revision: Revision, measured: Sequence[Measurement], *, deviates: bool) -> Facts:
    """Entries of the head; `deviates` is true if the report lists deviations."""
    manifest = run.manifest
    issued = instant(revision.issued.isoformat(), run.bench.site.time_zone)
    return [
        (tr("Issued"), issued),
        (tr("Order"), manifest.get("order") or tr("not stated")),
        (tr("Procedure"), manifest.get("procedure") or tr("not stated")),
        (tr("Method"), tr("; ").join(dict.fromkeys(_methods(run))) or tr("none")),
        (
            tr("Decision rule"),
            tr("; ").join(dict.fromkeys(_decision_rules(run, measured))) or tr("none: nothing is judged"),
        ),
        (tr("Ambient conditions"), tr("; ").join(_ambient(run)) or tr("not recorded")),
        (tr("Deviations"), tr("see below") if deviates else tr("none recorded")),
    ]


def _methods(run: StoredRun) -> Iterator[str]:
    """Methods with the standards that they follow; conformity to these is not claimed."""
    for entry in run.sequence.results:
        method = known_methods()[entry.method]
        if method.after:
            yield tr("{method}, after {standards}", method=tr(method.title), standards=", ".join(method.after))
        else:
            yield tr(method.title)


def _decision_rules(run: StoredRun, measured: Sequence[Measurement]) -> Iterator[str]:
    """Decision rule for each kind of limit of results and single measurements."""
    of_results = [limit.guard for entry in run.sequence.results for limit in entry.limits.values()]
    of_measurements = [found.limits.get("guard") for found in measured if found.limits is not None]
    for guard_k in (*of_results, *of_measurements):
        if guard_k is None:
            yield tr("simple acceptance: a value inside its limits passes")
        else:
            yield tr("guarded acceptance: a value passes that is inside its limits by {k} u", k=f"{guard_k:g}")


def _ambient(run: StoredRun) -> Iterator[str]:
    """Ambient conditions: readings of the room, from minimum to maximum over the run."""
    for name in run.bench.site.ambient:
        series = run.reader.series(name)
        if len(series.values):
            low, high = f"{series.values.min():.4g}", f"{series.values.max():.4g} {series.unit}"
            yield f"{name.replace('_', ' ')} {tr('{low} to {high}', low=low, high=high)}"
