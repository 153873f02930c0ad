"""Archives with rows of units that never were: a result per run, with a known drift."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from itertools import groupby
from pathlib import Path
from typing import Any

from bench.archive.columns import PARTITION
from bench.archive.destination import Destination
from bench.archive.query import Archive
from bench.archive.rows import as_table
from bench.archive.tables import Tables

FIRST = datetime(2024, 1, 10, 8, tzinfo=UTC)
DAY = timedelta(days=1)


def start_runtimes(folder: Path) -> None:
    """Start the threads and files that the libraries keep for the whole process, so that no test is blamed for them."""
    destination = Destination(str(folder))
    destination.begin()
    destination.digest("archive.json")
    Tables(destination).open("findings")
    Archive(destination).query("SELECT count(*) FROM findings")


def findings(
    serial: str, values: Sequence[float], *, every_days: float = 100, u: float = 1e-6, **more: Any
) -> list[dict[str, Any]]:
    """One result K0 of a unit in each of some runs, `every_days` apart, with limits of ±5 mg."""
    rows = []
    for number, value in enumerate(values):
        started = FIRST + number * every_days * DAY
        rows.append({
            "uuid": f"{serial}-{number:04}", "version": 1, "run": f"{started:%Y%m%dT%H%M%SZ}_tumble-static_{serial}",
            "started": started, PARTITION: started.year, "uut": serial, "sequence": "tumble_static", "simulated": False,
            "id": "tumble/a/K0@dwell=0", "result": "tumble/K0@dwell=0", "quantity": "K0", "name": "bias",
            "conditions": json.dumps({"dwell": 0}), "value": value, "unit": "g", "u": u, "expanded": 2 * u,
            "low": -5e-3, "high": 5e-3, "verdict": "PASS", "marginal": False, "flags": "[]", "shared": "{}", **more,
        })  # fmt: skip
    return rows


def with_runs(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of the runs that such findings belong to."""
    return [
        {
            **{name: row[name] for name in ("uuid", "version", "run", "started", PARTITION, "sequence", "simulated")},
            "units": row["uut"], "verdict": "PASS", "state": "completed",
            "publication": f"{row['uuid']}/{row['version']}",
            "files": "{}", "manifest": "{}", "bench": "bench A",
        }
        for row in rows
    ]  # fmt: skip


def fill(folder: Path, file: str = "made", **tables: list[dict[str, Any]]) -> Destination:
    """An archive in a folder with these rows, one file a year and table, of this name."""
    destination = Destination(str(folder))
    destination.begin()
    for name, rows in tables.items():
        ordered = sorted(rows, key=lambda row: row[PARTITION])
        for year, of_year in groupby(ordered, key=lambda row: row[PARTITION]):
            Tables(destination).append(name, as_table(name, list(of_year)), f"{file}-{year}")
    return destination
