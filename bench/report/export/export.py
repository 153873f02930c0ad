"""A run's data as files that other programs read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from bench.report.export.candump import export_candump
from bench.report.export.csv_cells import harmless, write_csv
from bench.report.export.hdf5 import export_hdf5
from bench.report.export.matlab import export_matlab
from bench.report.export.parquet import export_parquet
from bench.report.export.tables import TIMES, Table, tables

Exporter = Callable[[StoredRun, Path], list[Path]]


def export_csv(run: StoredRun, out: Path) -> list[Path]:
    """Write `readings.csv`, `journal.csv` and a table of each kind of output; `columns.csv` has the units.

    Times are seconds of bench time. Text that a spreadsheet would take for a formula is made harmless.
    """
    found = tables(run)
    written = [write_csv(out / f"{name}.csv", _rows(table)) for name, table in found.items()]
    return [*written, write_csv(out / "columns.csv", _columns(found))]


def _rows(table: Table) -> Iterator[Iterable[object]]:
    yield table.columns
    for words, columns in table.parts():
        cells = [harmless(word) for word in words.values()]
        for row in zip(*(_spelled(name, values) for name, values in columns.items()), strict=True):
            yield (*cells, *row)


def _spelled(name: str, values: Any) -> Iterator[object]:
    if name in TIMES:
        return (f"{value:.6f}" for value in values)
    every = values.tolist() if isinstance(values, np.ndarray) else values
    return (harmless(value) if isinstance(value, str) else repr(value) for value in every)


def _columns(found: Mapping[str, Table]) -> Iterator[Iterable[object]]:
    """Unit and meaning of each column of the other files."""
    yield ("table", "column", "unit", "description")
    for name, table in found.items():
        yield from ((name, key, column.unit, column.meaning) for key, column in table.columns.items())


def mark_damage(run: StoredRun, out: Path) -> list[Path]:
    """Write `DAMAGED.txt` beside the exported files of a damaged record; nothing for an intact one."""
    if not run.damage:
        return []
    path = out / "DAMAGED.txt"
    with atomic_file(path) as draft:
        lines = (f"The record of run {run.folder.name} is damaged; the files here were exported from it:", *run.damage)
        draft.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return [path]


FORMATS: dict[str, Exporter] = {
    "csv": export_csv,
    "candump": export_candump,
    "parquet": export_parquet,
    "matlab": export_matlab,
    "hdf5": export_hdf5,
}
