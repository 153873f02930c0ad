"""Write the report of a run as a page, as PDF (A4, with page numbers), or its results as JSON or CSV."""

from __future__ import annotations

import csv
import gc
import io
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.errors import BenchError, InputError
from bench.figures.languages import ENGLISH, language
from bench.files import atomic_file, write_atomically
from bench.metrology.results.coverage import COVERAGE
from bench.reduce.evaluate import Results
from bench.reduce.stored_run import StoredRun
from bench.report.afterwards import afterwards
from bench.report.approval import approval_of
from bench.report.export.csv_cells import harmless
from bench.report.html import render
from bench.report.paper import library, pdf
from bench.report.revision import replacing, revision_of, writing
from bench.store.runs import MANIFEST, json_text

REPORT = "report"
NEW_OBJECTS = 5000  # between two collections of garbage while a report is written; 700 in Python
COLUMNS = (
    "id", "uut", "quantity", "name", "at", "value", "unit", "u", "k", "dof", "min", "max", "guard", "u_max", "verdict",
    "marginal", "flags",
)  # fmt: skip


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Collect garbage less often in the block: what a page is made of stays until it is written."""
    before = gc.get_threshold()
    gc.set_threshold(NEW_OBJECTS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@seldom_collected()
def write_report(run: StoredRun, form: str = "html", lang: str = ENGLISH, out: Path | None = None) -> Path:
    """Evaluate a run, finished or not, and write `report.html`, or another form, to its directory or to a file `out`.

    Returns the path; in another language than English it is `report.zh.html`, of a damaged record
    `report.DAMAGED.html`. The page reports data that cannot be evaluated; `json` and `csv` contain only results, and
    raise the reason. Raises StoreError if it cannot be written, and InputError if the run has an approved report.
    """
    if out is not None:
        return _write_elsewhere(run, form, lang, out)
    parts = [REPORT, *(["DAMAGED"] if run.damage else []), *([lang] if lang != ENGLISH else []), form]
    path = run.folder / ".".join(parts)
    with writing(run.folder):
        expect_not_approved(run.folder)
        with language(lang):
            content = FORMS[form](run)
        with replacing(run.folder, path.name, content):
            write_atomically(path, content)
    return path


def expect_elsewhere(out: Path) -> None:
    """Raise InputError if a file would be in the directory of a run."""
    if (Path(os.path.realpath(out)).parent / MANIFEST).exists():
        raise InputError(f"{out}: is in the directory of a run; choose another place")


def _write_elsewhere(run: StoredRun, form: str, lang: str, out: Path) -> Path:
    expect_elsewhere(out)
    with writing(run.folder), language(lang):
        content = FORMS[form](run)
    with atomic_file(out) as draft:
        draft.write_bytes(content)
    return out


def expect_not_approved(folder: Path) -> None:
    """Raise InputError if a run has an approved report: another one beside it could be mistaken for it."""
    if (approval := approval_of(folder)) is not None:
        raise InputError(
            f"{folder.name}: is approved as {approval['report']}; no other report is written beside the approved one. "
            "Write a copy elsewhere (bench report --out FILE), or let an engineer issue the report again on the page "
            "of the run"
        )


@seldom_collected()
def report_to_issue(run: StoredRun, form: str, lang: str, approval: Mapping[str, Any]) -> bytes:
    """Return the report of a run with an approval that is not in its directory yet; `form` is html or pdf."""
    with language(lang):
        page = _page(run, approval)
    return page.encode() if form == "html" else pdf(page)


def _html(run: StoredRun) -> bytes:
    return _page(run).encode()


def _pdf(run: StoredRun) -> bytes:
    library()  # before the evaluation, which may take long
    return pdf(_page(run))


def _page(run: StoredRun, issued: Mapping[str, Any] | None = None) -> str:
    """Return the page; one of an approved run is a copy unless it is `issued` with an approval."""
    results, not_evaluated = None, ""
    try:
        results = run.evaluate()
    except BenchError as problem:
        not_evaluated = str(problem)
    after = afterwards(run.folder, run.bench.with_capability("thermal_chamber"))
    approval = issued if issued is not None else approval_of(run.folder)
    revision = revision_of(run.folder, run.manifest, results, not_evaluated, after, approval)
    return render(run, results, not_evaluated, revision, after, approval, is_copy=issued is None)


def _json(run: StoredRun) -> bytes:
    return json_text(run.evaluate().to_json()).encode()


def _csv(run: StoredRun) -> bytes:
    return spreadsheet(run.evaluate()).encode()


FORMS: Mapping[str, Callable[[StoredRun], bytes]] = {"html": _html, "pdf": _pdf, "json": _json, "csv": _csv}


def spreadsheet(results: Results) -> str:
    """A line for each finding, each single measurement and each acquisition with gaps; unknown values are empty.

    `u` is the standard uncertainty, `k` the coverage factor of U = k · u, `dof` its degrees of freedom, `inf` for
    unlimited. Text that a spreadsheet would take for a formula is made harmless.
    """
    content = results.to_json()
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in (*_findings(content), *_measurements(content), *_missed(content)):
        writer.writerow({name: harmless(cell) for name, cell in row.items()})
    return text.getvalue()


def _findings(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for finding in content["findings"]:
        yield {
            **finding,
            **(finding["limits"] or {}),
            "at": "; ".join(f"{name} {value}" for name, value in finding["at"].items() if value is not None),
            "dof": "inf" if finding["dof"] is None else finding["dof"],
            "flags": " ".join(finding["flags"]),
        }


def _measurements(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for found in content["measurements"]:
        limits = found["limits"] or {}
        yield {**found, **limits, "id": found["step"], "quantity": found["reading"], "k": COVERAGE}


def _missed(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Losses of a channel in an acquisition; its first gaps are in the column `at`."""
    for found in content.get("missed", ()):
        gaps = [f"{gap['first']}-{gap['last']}" for gap in found["listed"]]
        more = [f"{found['gaps']} in all"] if found["gaps"] > len(gaps) else []
        yield {
            "id": found["step"],
            "quantity": f"missed_{found['what']}",
            "name": f"{found['device']}.{found['channel']}",
            "at": "; ".join((*gaps, *more)),
            "value": found["lost"],
            "flags": " ".join(found["unusable"]),
        }
