"""SQL on an archive, by DuckDB.

The views `runs`, `findings`, `budgets`, `instruments` and `certificates` have the latest version of each run; the same
names with `all_` before them have every version.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from bench.archive.columns import TABLES
from bench.archive.destination import Destination
from bench.archive.libraries import duckdb
from bench.archive.tables import Tables
from bench.errors import InputError

AT_ONCE = 10_000  # rows
_LATEST = """
CREATE VIEW runs AS SELECT * EXCLUDE (newest) FROM (
  SELECT *, version = max(version) OVER (PARTITION BY uuid) AS newest FROM all_runs) WHERE newest
"""
_VISIBLE = "CREATE VIEW all_{name} AS SELECT * FROM _{name} SEMI JOIN all_runs USING (uuid, version)"
_OF_LATEST = "CREATE VIEW {name} AS SELECT * FROM _{name} SEMI JOIN runs USING (uuid, version)"


class Rows:
    """Result of a query: names of the columns, and the rows."""

    def __init__(self, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        self.columns, self.rows = tuple(columns), rows

    def records(self) -> list[dict[str, Any]]:
        """Return the rows as mappings."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


class Archive:
    """Opened archive for queries. Raises InputError if there is none, and StoreError."""

    def __init__(self, destination: Destination) -> None:
        self.destination = destination
        destination.expect()
        tables = Tables(destination)
        self._connection = duckdb().connect()
        for name in TABLES:
            self._connection.register(f"_{name}", tables.read(name))
        self._connection.execute("CREATE VIEW all_runs AS SELECT * FROM _runs")
        self._connection.execute(_LATEST)
        for name in TABLES:
            if name != "runs":
                self._connection.execute(_VISIBLE.format(name=name))
                self._connection.execute(_OF_LATEST.format(name=name))

    def query(self, sql: str, values: Sequence[Any] = ()) -> Rows:
        """Return the rows of a query, with `values` for its question marks. Raises InputError if it is wrong."""
        with self._in_words(sql):
            found = self._connection.execute(sql, list(values))
            if found.description is None:
                return Rows((), ())
            return Rows([column[0] for column in found.description], found.fetchall())

    def each(self, sql: str, values: Sequence[Any] = ()) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query, which are not all in memory; another query ends it.

        Raises InputError if it is wrong.
        """
        with self._in_words(sql):
            found = self._connection.execute(sql, list(values))
            while rows := found.fetchmany(AT_ONCE):
                yield from rows

    def arrow(self, sql: str) -> Any:
        """Return the rows of a query as an Arrow table. Raises InputError if it is wrong."""
        with self._in_words(sql):
            return self._connection.sql(sql).to_arrow_table()

    @contextmanager
    def _in_words(self, sql: str) -> Iterator[None]:
        try:
            yield
        except duckdb().Error as problem:
            raise InputError(f"the query '{' '.join(sql.split())[:120]}' cannot be answered: {problem}") from None


def opened(url: str) -> Archive:
    """Open an archive by its URL or folder."""
    return Archive(Destination(url))
