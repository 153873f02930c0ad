"""Runs and findings of an archive in a SQL database, for a MES or LIMS, by SQLAlchemy.

The tables `itb_runs` and `itb_findings` are created if they do not exist. The latest version of each run replaces an
earlier one in one transaction, so that an export that was interrupted goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from bench.archive.columns import FINDINGS, RUNS
from bench.archive.libraries import sqlalchemy
from bench.archive.query import Archive
from bench.errors import InputError, StoreError

OF_RUN = (
    "uuid", "version", "publication", "run", "started", "ended", "published", "program", "sequence", "title", "bench",
    "preset", "simulated", "operator", "work_order", "procedure", "state", "verdict", "units", "report", "approved",
    "approved_by", "folder",
)  # fmt: skip
OF_FINDING = (
    "uuid", "id", "uut", "quantity", "name", "conditions", "temperature_c", "value", "unit", "u", "expanded", "low",
    "high", "verdict", "marginal", "flags",
)  # fmt: skip
_LONG = ("conditions", "flags", "title", "units", "folder")  # texts of any length; the others are indexed or short
SHORT = 300


class SqlDatabase:
    """Opened SQL database with the two tables. Raises InputError for a wrong URL, and StoreError."""

    def __init__(self, url: str) -> None:
        sql = sqlalchemy()
        try:
            self._engine = sql.create_engine(url)
            self.name = self._engine.url.render_as_string(hide_password=True)
        except sql.exc.SQLAlchemyError as problem:
            raise InputError(f"the URL of the database is wrong: {problem}") from None
        except ImportError as problem:
            raise InputError(f"the driver of the database is not installed: {problem}") from None
        meta = sql.MetaData()
        self._runs = sql.Table("itb_runs", meta, *_columns(OF_RUN, RUNS, ("uuid",)))
        self._findings = sql.Table("itb_findings", meta, *_columns(OF_FINDING, FINDINGS, ("uuid", "id")))
        self._in_words(lambda: meta.create_all(self._engine))

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def upsert(self, archive: Archive, watch: Callable[[str], None] = lambda _: None) -> int:
        """Write the runs that are new or have a new version; return their number.

        `watch` is called with the name of each run once it is there.
        """
        known = self._in_words(self._publications)
        rows = archive.query("SELECT uuid, publication FROM runs ORDER BY started").rows
        new = [uuid for uuid, publication in rows if known.get(uuid) != publication]
        for uuid in new:
            of_run, findings = _rows(archive, "runs", OF_RUN, uuid), _rows(archive, "findings", OF_FINDING, uuid)
            self._in_words(partial(self._replace, uuid, of_run, findings))
            watch(str(of_run[0]["run"]))
        return len(new)

    def _replace(self, uuid: str, run: list[dict[str, Any]], findings: list[dict[str, Any]]) -> None:
        sql = sqlalchemy()
        with self._engine.begin() as connection:
            for table, rows in ((self._findings, findings), (self._runs, run)):
                connection.execute(sql.delete(table).where(table.c.uuid == uuid))
                if rows:
                    connection.execute(sql.insert(table), rows)

    def _publications(self) -> Mapping[str, str]:
        sql = sqlalchemy()
        with self._engine.connect() as connection:
            found = connection.execute(sql.select(self._runs.c.uuid, self._runs.c.publication))
            return {str(row.uuid): str(row.publication) for row in found}

    def _in_words(self, work: Callable[[], Any]) -> Any:
        try:
            return work()
        except sqlalchemy().exc.SQLAlchemyError as problem:
            text = str(getattr(problem, "orig", None) or problem).strip().splitlines()
            raise StoreError(f"{self.name}: {text[0] if text else problem}; the export can be repeated") from None


def _rows(archive: Archive, table: str, columns: tuple[str, ...], uuid: str) -> list[dict[str, Any]]:
    return archive.query(f"SELECT {', '.join(columns)} FROM {table} WHERE uuid = ?", [uuid]).records()  # noqa: S608  constants


def _columns(names: tuple[str, ...], known: Mapping[str, str], primary: tuple[str, ...]) -> list[Any]:
    sql = sqlalchemy()
    kinds = {
        "string": sql.String(SHORT), "json": sql.Text(), "int64": sql.BigInteger(), "double": sql.Double(),
        "bool": sql.Boolean(), "instant": sql.DateTime(timezone=True), "day": sql.Date(),
    }  # fmt: skip
    return [
        sql.Column(
            name, sql.Text() if name in _LONG else kinds[known[name]], primary_key=name in primary,
            index=name in ("uut", "started", "quantity"),
        )
        for name in names
    ]  # fmt: skip
