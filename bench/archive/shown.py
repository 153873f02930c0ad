"""Answers of an archive as text for a terminal, and as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from bench.archive.libraries import parquet
from bench.archive.query import Archive, Rows
from bench.archive.units import Compared, Due
from bench.errors import InputError
from bench.figures.columns import in_columns
from bench.figures.numbers import scale_shown, with_expanded
from bench.files import atomic_file
from bench.report.export.csv_cells import harmless, write_csv
from bench.station.units.history import SeriesView, UnitHistory

WIDEST = 60  # characters of a cell on a terminal
BEYOND = 1.0  # E_n above which two results differ


def table_lines(found: Rows) -> Iterator[str]:
    """Lines of a table with its header."""
    rows = [[_cell(value) for value in row] for row in found.rows]
    numbers = [all(isinstance(row[n], int | float) for row in found.rows) for n in range(len(found.columns))]
    align = "".join(">" if number else "<" for number in numbers)
    yield from in_columns([list(found.columns), *rows], align, indent="")


def _cell(value: Any) -> str:
    match value:
        case None:
            return "-"
        case float():
            return f"{value:.9g}"
        case datetime():
            return value.isoformat(sep=" ", timespec="seconds")
    text = str(value)
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"


def written(archive: Archive, sql: str, out: Path) -> Path:
    """Write the answer to a query as CSV or Parquet, by the name of the file. Raises InputError."""
    if out.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out {out}: expected a name that ends in .csv or .parquet")
    if out.suffix == ".parquet":
        with atomic_file(out) as draft:
            parquet().write_table(archive.arrow(sql), draft, compression="zstd")
        return out
    found = archive.query(sql)
    return write_csv(out, [found.columns, *(map(harmless, row) for row in found.rows)])


def history_lines(found: UnitHistory) -> Iterator[str]:
    """Lines on all calibrations of a unit: each result with its expanded uncertainty, E_n and drift."""
    yield f"{found.uut}: {len(found.runs)} runs, the last {found.runs[0]}"
    for series in found.series:
        yield ""
        yield from _series_lines(series)
    if found.next_due is not None:
        yield ""
        yield f"A result ({found.next_due_by}) may reach its limit on {found.next_due.date()} by its drift."


def _series_lines(series: SeriesView) -> Iterator[str]:
    scale, unit = scale_shown(series.quantity, series.unit)
    yield f"{series.key.rpartition(' / ')[0]}: {series.name}, in {unit or '1'}"
    rows = [
        (
            each.at.date().isoformat(), with_expanded(each.value * scale, each.expanded * scale), each.verdict or "",
            "" if each.e_n is None else f"E_n {_e_n(each.e_n)}", each.run,
        )
        for each in series.points
    ]  # fmt: skip
    yield from in_columns(rows, "<><><")
    if (drift := series.drift) is not None:
        text = with_expanded(drift.per_year * scale, drift.expanded * scale)
        remarks = ["significant" if drift.significant else "not significant"]
        remarks += [] if drift.fits else ["the values scatter more than their uncertainties explain"]
        yield f"  drift {text} {unit} per year: {', '.join(remarks)}"


def compared_lines(found: Sequence[Compared]) -> Iterator[str]:
    """Lines of two runs side by side."""
    rows: list[Sequence[str]] = [("result", "first", "second", "difference", "unit", "E_n")]
    for each in found:
        values = [_number(each.first), _number(each.second), _number(each.difference)]
        rows.append((each.result, *values, each.unit, "" if each.e_n is None else _e_n(each.e_n)))
    yield from in_columns(rows, "<>>><>", indent="")


def _e_n(value: float) -> str:
    """E_n of two results, marked if they differ."""
    return f"{value:+.2f}{' !' if abs(value) > BEYOND else ''}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.9g}"


def due_lines(found: Sequence[Due]) -> Iterator[str]:
    """Lines on instruments and units that are due."""
    yield from in_columns([(each.when.isoformat(), each.what, each.why) for each in found], "<<<", indent="")
