"""A run's data as Parquet: for pandas, Polars, DuckDB, Spark and MATLAB's parquetread."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.files import atomic_file
from bench.optional import imported
from bench.reduce.stored_run import StoredRun
from bench.report.export.tables import FIXED, TIMES, WHOLE_NUMBERS, Table, tables

ROWS_OF_GROUP = 1 << 16  # enough for encodings to be efficient, and the maximum in memory
_TYPES = {**dict.fromkeys((*TIMES, *FIXED, "value"), "float64"), **dict.fromkeys(WHOLE_NUMBERS, "int64")}
_ENCODINGS = {"float64": "BYTE_STREAM_SPLIT", "int64": "DELTA_BINARY_PACKED"}


def export_parquet(run: StoredRun, out: Path) -> list[Path]:
    """Write `readings.parquet`, `journal.parquet` and a table of each kind of output.

    Counters and numbers are stored as differences.
    """
    arrow, parquet = imported("pyarrow", "parquet"), imported("pyarrow.parquet", "parquet")
    return [_write(arrow, parquet, out / f"{name}.parquet", table) for name, table in tables(run).items()]


def _write(arrow: Any, parquet: Any, path: Path, table: Table) -> Path:
    """Write a table; parts are collected to groups of rows, each of which is written once complete."""
    schema = arrow.schema(
        [
            arrow.field(name, _TYPES.get(name, "string"), metadata={"unit": column.unit, "description": column.meaning})
            for name, column in table.columns.items()
        ]
    )
    encodings = {name: _ENCODINGS[_TYPES[name]] for name in table.columns if name in _TYPES}
    words = [name for name in table.columns if name not in _TYPES and name != "data"]
    with (
        atomic_file(path) as draft,
        parquet.ParquetWriter(
            draft, schema, compression="zstd", use_dictionary=words, column_encoding=encodings
        ) as writer,
    ):
        for parts in _groups(_part(arrow, schema, {**words, **rows}) for words, rows in table.parts()):
            writer.write_table(arrow.concat_tables(parts), row_group_size=ROWS_OF_GROUP)
    return path


def _part(arrow: Any, schema: Any, batch: Mapping[str, Any]) -> Any:
    """A part as a table; a single word stands for a whole column."""
    rows = next(len(values) for values in batch.values() if not isinstance(values, str))
    columns = [
        arrow.repeat(arrow.scalar(values), rows) if isinstance(values, str) else arrow.array(values, field.type)
        for field, values in zip(schema, batch.values(), strict=True)
    ]
    return arrow.Table.from_arrays(columns, schema=schema)


def _groups(parts: Iterator[Any]) -> Iterator[Sequence[Any]]:
    collected: list[Any] = []
    for part in parts:
        collected.append(part)
        if sum(each.num_rows for each in collected) >= ROWS_OF_GROUP:
            yield collected
            collected = []
    if collected:
        yield collected
