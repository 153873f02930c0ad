"""Positions in the journals of runs up to which a broker has acknowledged them; on the disk."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import NamedTuple

from bench.errors import StoreError
from bench.files import make_folder
from bench.store.database import closed_on_error

FILE_NAME = "mqtt.db"
CONNECTIONS = 256
_TABLES = """
CREATE TABLE IF NOT EXISTS run(name TEXT PRIMARY KEY, seq INTEGER NOT NULL, mark TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS connection(number INTEGER NOT NULL, begun INTEGER NOT NULL);
INSERT INTO connection SELECT 0, 0 WHERE NOT EXISTS (SELECT 1 FROM connection);
"""


class Position(NamedTuple):
    """Last acknowledged entry of a run; `mark` is "", or the state of the run of which everything was acknowledged."""

    seq: int = 0
    mark: str = ""


class Positions:
    """Positions of all runs, used by one thread at a time. Raises StoreError.

    `is_new` is True until `begin`: then the runs that have ended before are not published.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        try:
            make_folder(folder)
            self._database = sqlite3.connect(self.path, isolation_level=None, timeout=5, check_same_thread=False)
            with closed_on_error(self._database):
                self._database.execute("PRAGMA journal_mode=WAL")
                self._database.execute("PRAGMA synchronous=FULL")
                self._database.executescript(_TABLES)
                rows = self._database.execute("SELECT name, seq, mark FROM run").fetchall()
                self.is_new = not self._database.execute("SELECT begun FROM connection").fetchone()[0]
        except (OSError, sqlite3.Error) as problem:
            raise StoreError(f"{self.path}: cannot be opened ({problem})") from problem
        self._of = {name: Position(seq, mark) for name, seq, mark in rows}

    def of(self, run: str) -> Position:
        """Return the position of a run."""
        return self._of.get(run, Position())

    def begin(self, ended: dict[str, Position]) -> None:
        """Begin with runs of which nothing more is to be published."""
        self._written("INSERT OR REPLACE INTO run VALUES (?, ?, ?)", [(name, *each) for name, each in ended.items()])
        self._of |= ended
        self._written("UPDATE connection SET begun = ?", [(1,)])
        self.is_new = False

    def move(self, run: str, position: Position) -> None:
        """Note, durably, what was acknowledged."""
        self._written("INSERT OR REPLACE INTO run VALUES (?, ?, ?)", [(run, *position)])
        self._of[run] = position

    def next_connection(self) -> int:
        """Return the number of a new connection, 0 to 255, durably different from the one before."""
        number = int(self._database.execute("SELECT number FROM connection").fetchone()[0]) + 1
        self._written("UPDATE connection SET number = ?", [(number % CONNECTIONS,)])
        return number % CONNECTIONS

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _written(self, statement: str, rows: list[tuple[object, ...]]) -> None:
        try:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.executemany(statement, rows)
            self._database.execute("COMMIT")
        except sqlite3.Error as problem:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise StoreError(f"{self.path}: cannot be written ({problem})") from problem
