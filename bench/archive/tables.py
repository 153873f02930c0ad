"""Delta tables of an archive: appending the rows of a run once, and merging small files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from bench.archive.columns import PARTITION, SORTED_BY, TABLES, schema
from bench.archive.destination import Destination, in_words
from bench.archive.libraries import arrow, deltalake, parquet
from bench.clock import wall_utc
from bench.errors import StoreError

ATTEMPTS = 10  # of a commit, against other writers
STATISTICS = ("string", "int64", "double")  # kinds of columns whose range a reader needs to skip a file
LONGEST = 200  # characters of a text in the statistics
ROWS_OF_GROUP = 1 << 15
KEPT = "interval 30 days"  # of the log of a table, which has its earlier versions


class Tables:
    """Tables of an archive; all methods raise StoreError."""

    def __init__(self, destination: Destination) -> None:
        self._destination = destination

    def open(self, name: str) -> Any:
        """Return a table; it is created if it does not exist."""
        with self._errors(name):
            for _ in range(ATTEMPTS):
                if (found := self._found(name)) is not None and not (lacking := _lacking(found, name)):
                    return found
                with suppress(deltalake().exceptions.CommitFailedError):  # another bench has done it meanwhile
                    if found is not None:
                        found.alter.add_columns(lacking)
                        continue
                    deltalake().DeltaTable.create(
                        self._destination.table_url(name), schema(name), mode="ignore", partition_by=[PARTITION],
                        storage_options=dict(self._destination.options),
                        configuration={"delta.logRetentionDuration": KEPT},
                    )  # fmt: skip
        raise StoreError(f"{self._destination.table_url(name)}: cannot be created")

    def read(self, name: str) -> Any:
        """Return what a query reads of a table: an Arrow dataset, or an empty Arrow table if there is none yet."""
        with self._errors(name):
            found = self._found(name)
            if found is None:
                return schema(name).empty_table()
            dataset = found.to_pyarrow_dataset()
            return dataset.replace_schema(schema(name)) if _lacking(found, name) else dataset

    def _found(self, name: str) -> Any:
        """Return a table, or None if it does not exist."""
        with suppress(deltalake().exceptions.TableNotFoundError):
            return deltalake().DeltaTable(
                self._destination.table_url(name), storage_options=dict(self._destination.options)
            )
        return None

    def holds(self, name: str, uuid: str, version: int, year: int) -> bool:
        """Return True if a table has rows of a version of a run."""
        with self._errors(name):
            table = self._found(name)
            filters = [(PARTITION, "=", year), ("uuid", "=", uuid), ("version", "=", version)]
            return table is not None and bool(table.to_pyarrow_table(columns=["uuid"], filters=filters).num_rows)

    def append(self, name: str, rows: Any, file: str) -> None:
        """Append rows of one year as a file of the given name, once: a commit of a file that is there changes nothing.

        `rows` is an Arrow table with the columns of the table; without rows, nothing is written.
        """
        if not rows.num_rows:
            return
        year = rows[PARTITION][0].as_py()
        stored = rows.drop_columns([PARTITION])
        data = _as_parquet(stored)
        path = f"{PARTITION}={year}/{file}.parquet"
        self._destination.write(f"tables/{name}/{path}", data)
        actions = deltalake("deltalake.transaction")
        added = actions.AddAction(
            path, len(data), {PARTITION: str(year)}, int(wall_utc().timestamp() * 1000), True, _statistics(name, stored)
        )
        with self._errors(name):
            for attempt in range(1, ATTEMPTS + 1):
                table = self.open(name)
                try:
                    table.create_write_transaction([added], "append", table.schema(), partition_by=[PARTITION])
                except deltalake().exceptions.CommitFailedError:
                    if attempt == ATTEMPTS:
                        raise
                else:
                    return

    def tidy(self) -> Mapping[str, tuple[int, int]]:
        """Merge and sort the files of each table by year; return the number of files before and after by table.

        Removed files are deleted a week later at the earliest, by the next call: somebody may be reading them.
        """
        return {name: self._tidied(name) for name in TABLES}

    def _tidied(self, name: str) -> tuple[int, int]:
        table = self.open(name)
        with self._errors(name):
            before = len(table.file_uris())
            years = [
                year
                for year in sorted({each[PARTITION] for each in table.partitions()}, key=str)
                if len(table.file_uris([(PARTITION, "=", str(year))])) > 1
            ]
            for year in years:
                table.optimize.z_order(  # by one column: a curve over several would spread each unit over all groups
                    [SORTED_BY[name][0]], partition_filters=[(PARTITION, "=", str(year))],
                    writer_properties=deltalake().WriterProperties(
                        compression="ZSTD", max_row_group_size=ROWS_OF_GROUP
                    ),
                )  # fmt: skip
            table.vacuum(dry_run=False)
            table.create_checkpoint()
            return before, len(self.open(name).file_uris())

    @contextmanager
    def _errors(self, name: str) -> Iterator[None]:
        try:
            yield
        except (deltalake().exceptions.DeltaError, OSError, arrow().ArrowException) as problem:
            raise StoreError(in_words(self._destination.table_url(name), problem)) from None


def _lacking(table: Any, name: str) -> list[Any]:
    """Return the columns that earlier versions of this program did not have."""
    known = {field.name for field in table.schema().fields}
    of_table = deltalake().Schema.from_arrow(schema(name))
    return [field for field in of_table.fields if field.name not in known]


def _as_parquet(rows: Any) -> bytes:
    sink = arrow().BufferOutputStream()
    parquet().write_table(rows, sink, compression="zstd", row_group_size=ROWS_OF_GROUP)
    return bytes(sink.getvalue())


def _statistics(name: str, rows: Any) -> str:
    """Number of rows and range of each column as JSON, as the Delta protocol has it for an added file."""
    compute = arrow().compute
    least: dict[str, Any] = {}
    most: dict[str, Any] = {}
    empty: dict[str, int] = {}
    for column, kind in TABLES[name].items():
        values = rows[column]
        empty[column] = values.null_count
        if kind not in STATISTICS or values.null_count == len(values):
            continue
        found = compute.min_max(values).as_py()
        if kind == "string" and max(len(found["min"]), len(found["max"])) > LONGEST:
            continue
        least[column], most[column] = found["min"], found["max"]
    return json.dumps(
        {"numRecords": rows.num_rows, "minValues": least, "maxValues": most, "nullCount": empty}, ensure_ascii=False
    )
