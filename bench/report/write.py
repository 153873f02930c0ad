"""Writes the report of a run."""

from __future__ import annotations

from pathlib import Path

from bench.errors import BenchError
from bench.report.html import render
from bench.report.stored import StoredRun
from bench.store.runs import write_whole

REPORT = "report.html"


def write_report(run: StoredRun) -> Path:
    """Evaluates a run, finished or not, and writes `report.html` into its directory; the path of it.

    Data that cannot be evaluated are told in the report. Raises StoreError when it cannot be written.
    """
    results, not_evaluated = None, ""
    try:
        results = run.evaluate()
    except BenchError as problem:
        not_evaluated = str(problem)
    path = run.folder / REPORT
    write_whole(path, render(run, results, not_evaluated).encode())
    return path
