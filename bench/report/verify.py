"""Verification of a run directory: its record, and the reports written from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bench.report.revision import changed_reports
from bench.store.verify import Record, examine


def examined(folder: Path) -> Record:
    """Full examination of a run directory; reads every row and every file."""
    record = examine(folder)
    return replace(record, damage=(*record.damage, *changed_reports(folder)))


def verify(folder: Path) -> list[str]:
    """Problems of a run's files; empty if there are none."""
    return list(examined(folder).damage)
