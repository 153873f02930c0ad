"""A run's data as Parquet: for pandas, Polars, DuckDB, Spark and MATLAB's parquetread."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from bench.report.export.tables import (
    FIXED,
    JOURNAL,
    READINGS,
    TIMES,
    WHOLE_NUMBERS,
    Acquired,
    Column,
    acquired,
    journal,
    readings,
)
from bench.report.optional import imported

ROWS_OF_GROUP = 1 << 16  # enough for encodings to be efficient, and the maximum in memory
_TYPES = {**dict.fromkeys((*TIMES, *FIXED, "value"), "float64"), **dict.fromkeys(WHOLE_NUMBERS, "int64")}
_ENCODINGS = {"float64": "BYTE_STREAM_SPLIT", "int64": "DELTA_BINARY_PACKED"}

Batch = Mapping[str, Any]


def export_parquet(run: StoredRun, out: Path) -> list[Path]:
    """Write `readings.parquet`, `journal.parquet` and a table of each kind of output.

    Counters and numbers are stored as differences.
    """
    arrow, parquet = imported("pyarrow", "parquet"), imported("pyarrow.parquet", "parquet")
    tables = {
        "readings": (READINGS, _readings(run)),
        **{name: (table.columns, _acquired(run, table)) for name, table in acquired(run).items()},
        "journal": (JOURNAL, _journal(run)),
    }
    return [_write(arrow, parquet, out / f"{name}.parquet", *table) for name, table in tables.items()]


def _readings(run: StoredRun) -> Iterator[Batch]:
    for series in readings(run):
        yield {"name": series.name, "unit": series.unit, "t_s": series.at_s, "value": series.values}


def _acquired(run: StoredRun, table: Acquired) -> Iterator[Batch]:
    return ({**words, **columns} for words, columns in table.parts(run))


def _journal(run: StoredRun) -> Iterator[Batch]:
    rows = ((event.seq, event.at_s, event.kind, event.step, data) for event, data in journal(run))
    while some := list(islice(rows, ROWS_OF_GROUP)):
        yield dict(zip(JOURNAL, zip(*some, strict=True), strict=True))


def _write(arrow: Any, parquet: Any, path: Path, columns: Mapping[str, Column], batches: Iterator[Batch]) -> Path:
    """Write a table; batches are collected to groups of rows, each of which is written once complete."""
    schema = arrow.schema(
        [
            arrow.field(name, _TYPES.get(name, "string"), metadata={"unit": column.unit, "description": column.meaning})
            for name, column in columns.items()
        ]
    )
    encodings = {name: _ENCODINGS[_TYPES[name]] for name in columns if name in _TYPES}
    words = [name for name in columns if name not in _TYPES and name != "data"]
    with (
        atomic_file(path) as draft,
        parquet.ParquetWriter(
            draft, schema, compression="zstd", use_dictionary=words, column_encoding=encodings
        ) as writer,
    ):
        for tables in _groups(_table(arrow, schema, batch) for batch in batches):
            writer.write_table(arrow.concat_tables(tables), row_group_size=ROWS_OF_GROUP)
    return path


def _table(arrow: Any, schema: Any, batch: Batch) -> Any:
    """A batch as a table; a single word stands for a whole column."""
    rows = next(len(values) for values in batch.values() if not isinstance(values, str))
    columns = [
        arrow.repeat(arrow.scalar(values), rows) if isinstance(values, str) else arrow.array(values, field.type)
        for field, values in zip(schema, batch.values(), strict=True)
    ]
    return arrow.Table.from_arrays(columns, schema=schema)


def _groups(tables: Iterator[Any]) -> Iterator[Sequence[Any]]:
    collected: list[Any] = []
    for table in tables:
        collected.append(table)
        if sum(each.num_rows for each in collected) >= ROWS_OF_GROUP:
            yield collected
            collected = []
    if collected:
        yield collected
