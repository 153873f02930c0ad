"""Writes the report of a run."""

from __future__ import annotations

from pathlib import Path

from bench.report.stored import StoredRun


def write_report(run: StoredRun) -> Path:
    """The path of `report.html` in the run's directory."""
    return run.folder / "report.html"
