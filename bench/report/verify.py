"""Whether a run directory is as it was written: its record, and the reports that were made of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bench.report.revision import changed_reports
from bench.store.verify import Record, examine


def examined(folder: Path) -> Record:
    """All that can be known of a run directory; reads every row and every file."""
    record = examine(folder)
    return replace(record, damage=(*record.damage, *changed_reports(folder)))


def verify(folder: Path) -> list[str]:
    """What is wrong with a run's files; empty when nothing is."""
    return list(examined(folder).damage)
