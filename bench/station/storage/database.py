"""Database of a station: tables and transactions. An answer is given when its effect is on the disk."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from bench.errors import InUseError, StoreError
from bench.files import DRAFT, make_folder
from bench.store.database import closed_on_error

FILE_NAME = "station.db"
VERSION = 1
_SCHEMA = """
CREATE TABLE item(id TEXT PRIMARY KEY, number INTEGER NOT NULL UNIQUE, bench TEXT NOT NULL, state TEXT NOT NULL,
  priority INTEGER NOT NULL, place REAL NOT NULL, version INTEGER NOT NULL, data TEXT NOT NULL);
CREATE INDEX item_by_state ON item(state, bench);
CREATE TABLE reply(key TEXT PRIMARY KEY, of TEXT NOT NULL, item TEXT NOT NULL, at TEXT NOT NULL);
CREATE TABLE stopped(bench TEXT PRIMARY KEY, reason TEXT NOT NULL, at TEXT NOT NULL);
CREATE TABLE audit(number INTEGER PRIMARY KEY, at TEXT NOT NULL, data TEXT NOT NULL, head TEXT NOT NULL);
"""


class Database:
    """SQLite database of a station, of one process at a time; used by one thread.

    Raises StoreError where the disk fails, and InUseError where another station has it open.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        self._afterwards: list[Callable[[], object]] = []
        try:
            make_folder(folder)
            folder.chmod(0o700)
            self._database = sqlite3.connect(self.path, isolation_level=None, timeout=0.5, check_same_thread=False)
            with closed_on_error(self._database):
                self._database.row_factory = sqlite3.Row
                # The first reading takes the lock, which the system removes with the process.
                self._database.execute("PRAGMA locking_mode=EXCLUSIVE")
                self._database.execute("PRAGMA journal_mode=WAL")
                self._database.execute("PRAGMA synchronous=FULL")
                self._expect_version()
        except sqlite3.OperationalError as problem:
            if "locked" in str(problem):
                raise InUseError(f"{self.path}: another station of this folder is running") from None
            raise StoreError(f"{self.path}: cannot be opened ({problem})") from problem
        except (OSError, sqlite3.Error) as problem:
            raise StoreError(f"{self.path}: cannot be opened ({problem})") from problem

    def _expect_version(self) -> None:
        version = self._database.execute("PRAGMA user_version").fetchone()[0]
        if version == 0:
            self._database.executescript(f"BEGIN EXCLUSIVE; {_SCHEMA} PRAGMA user_version={VERSION}; COMMIT;")
        elif version != VERSION:
            raise StoreError(f"{self.path}: has format {version}, this program has format {VERSION}")
        self._database.execute("BEGIN EXCLUSIVE")  # takes the lock, also where there is nothing to create
        self._database.execute("COMMIT")

    def close(self) -> None:
        """Close the database and release its lock; closing twice is harmless."""
        self._database.close()

    def copy_to(self, path: Path) -> None:
        """Write a whole copy of the database to a new file, of this user alone. Raises StoreError."""
        draft = path.with_name(path.name + DRAFT)
        try:
            os.close(os.open(draft, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_CLOEXEC, 0o600))
            with closing(sqlite3.connect(draft)) as copy:
                self._database.backup(copy)
                copy.execute("PRAGMA journal_mode=DELETE")  # one file
                (found,) = copy.execute("PRAGMA integrity_check").fetchone()
            if found != "ok":
                raise StoreError(f"{self.path}: is damaged ({found})")
            draft.replace(path)
        except (OSError, sqlite3.Error) as problem:
            raise StoreError(f"{path}: cannot be written ({problem})") from problem
        finally:
            draft.unlink(missing_ok=True)

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Make all changes of the block durable at its end, or none of them. Raises StoreError.

        A block inside another one is part of it; the outer one must then end as the inner one does.
        """
        if self._database.in_transaction:
            yield self._database
            return
        try:
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield self._database
            except BaseException:
                self._database.execute("ROLLBACK")
                raise
            self._database.execute("COMMIT")
        except sqlite3.Error as problem:
            raise StoreError(f"{self.path}: cannot be written ({problem})") from problem
        finally:
            calls, self._afterwards = self._afterwards, []
        for call in calls:
            call()

    def after_commit(self, call: Callable[[], object]) -> None:
        """Call a function when the transaction in progress is durable, and not if it fails; else now."""
        if self._database.in_transaction:
            self._afterwards.append(call)
        else:
            call()

    def rows(self, query: str, *values: object) -> list[sqlite3.Row]:
        """Return the rows of a query. Raises StoreError."""
        try:
            return self._database.execute(query, values).fetchall()
        except sqlite3.Error as problem:
            raise StoreError(f"{self.path}: cannot be read ({problem})") from problem
