"""Write the report of a run in the requested form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from bench.errors import BenchError
from bench.figures.languages import ENGLISH, language
from bench.files import write_atomically
from bench.reduce.stored_run import StoredRun
from bench.report.afterwards import afterwards
from bench.report.html import render
from bench.report.pdf import library, pdf
from bench.report.results_csv import spreadsheet
from bench.report.revision import replacing, revision_of
from bench.store.runs import json_text

REPORT = "report"


def write_report(run: StoredRun, form: str = "html", lang: str = ENGLISH) -> Path:
    """Evaluate a run, finished or not, and write `report.html`, or another form, to its directory.

    Returns the path; in another language than English it is `report.zh.html`, of a damaged record
    `report.DAMAGED.html`. The page reports data that cannot be evaluated; `json` and `csv` contain only results, and
    raise the reason. Raises StoreError if it cannot be written.
    """
    parts = [REPORT, *(["DAMAGED"] if run.damage else []), *([lang] if lang != ENGLISH else []), form]
    path = run.folder / ".".join(parts)
    with language(lang):
        content = FORMS[form](run)
    with replacing(run.folder, path.name, content):
        write_atomically(path, content)
    return path


def _html(run: StoredRun) -> bytes:
    return _page(run).encode()


def _pdf(run: StoredRun) -> bytes:
    library()  # before the evaluation, which may take long
    return pdf(_page(run))


def _page(run: StoredRun) -> str:
    results, not_evaluated = None, ""
    try:
        results = run.evaluate()
    except BenchError as problem:
        not_evaluated = str(problem)
    after = afterwards(run.folder, run.bench.with_capability("thermal_chamber"))
    revision = revision_of(run.folder, run.manifest, results, not_evaluated, after)
    return render(run, results, not_evaluated, revision, after)


def _json(run: StoredRun) -> bytes:
    return json_text(run.evaluate().to_json()).encode()


def _csv(run: StoredRun) -> bytes:
    return spreadsheet(run.evaluate()).encode()


FORMS: Mapping[str, Callable[[StoredRun], bytes]] = {"html": _html, "pdf": _pdf, "json": _json, "csv": _csv}
