"""A run's data as files that other programs read."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from bench.report.export.candump import export_candump
from bench.report.export.csv_cells import harmless
from bench.report.export.hdf5 import export_hdf5
from bench.report.export.matlab import export_matlab
from bench.report.export.parquet import export_parquet
from bench.report.export.tables import JOURNAL, READINGS, TIMES, Acquired, acquired, journal, readings

Exporter = Callable[[StoredRun, Path], list[Path]]


def export_csv(run: StoredRun, out: Path) -> list[Path]:
    """Write `readings.csv`, `journal.csv` and a table of each kind of output; `columns.csv` has the units.

    Times are seconds of bench time. Text that a spreadsheet would take for a formula is made harmless.
    """
    writers: dict[str, Iterator[Iterable[object]]] = {
        "readings": _readings(run),
        **{name: _acquired(run, table) for name, table in acquired(run).items()},
        "journal": _journal(run),
        "columns": _columns(run),
    }
    return [_write_csv(out / f"{name}.csv", rows) for name, rows in writers.items()]


def _readings(run: StoredRun) -> Iterator[Iterable[object]]:
    yield READINGS
    for series in readings(run):
        name, unit = harmless(series.name), harmless(series.unit)
        for at_s, value in zip(series.at_s.tolist(), series.values.tolist(), strict=True):
            yield (name, unit, f"{at_s:.6f}", repr(value))


def _acquired(run: StoredRun, table: Acquired) -> Iterator[Iterable[object]]:
    yield table.columns
    for words, columns in table.parts(run):
        spelled = [
            [f"{value:.6f}" for value in values.tolist()] if name in TIMES else map(repr, values.tolist())
            for name, values in columns.items()
        ]
        cells = [harmless(word) for word in words.values()]
        for row in zip(*spelled, strict=True):
            yield (*cells, *row)


def _journal(run: StoredRun) -> Iterator[Iterable[object]]:
    yield JOURNAL
    for event, data in journal(run):
        yield (event.seq, f"{event.at_s:.6f}", harmless(event.kind), harmless(event.step), harmless(data))


def _columns(run: StoredRun) -> Iterator[Iterable[object]]:
    """Unit and meaning of each column of the other files."""
    yield ("table", "column", "unit", "description")
    outputs = {name: table.columns for name, table in acquired(run).items()}
    for table, columns in {"readings": READINGS, **outputs, "journal": JOURNAL}.items():
        yield from ((table, name, column.unit, column.meaning) for name, column in columns.items())


def _write_csv(path: Path, rows: Iterable[Iterable[object]]) -> Path:
    with atomic_file(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    return path


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
