"""Tables of a run, and the SQLite settings that make a commit durable."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from bench.errors import StoreError
from drivers.schema.bounded import UnfitFileError, expect_bounded

VERSION = 3
READABLE = (1, 2, 3)  # format 1 has no chain, format 2 no blocks by message
FILE_NAME = "run.db"
LOG_NAME = f"{FILE_NAME}-wal"
LOG_BYTES = 2**22  # a little more than the 1000 pages after which SQLite begins its log anew
TABLES = {"journal": 5, "block": 8, "channel": 3, "reading": 4, "sample": 5}  # number of columns of each table
CHAIN = "chain"
CHAIN_COLUMNS = 2 + len(TABLES)
_SCHEMA = """
CREATE TABLE journal(seq INTEGER PRIMARY KEY, at_s REAL NOT NULL, kind TEXT NOT NULL, step TEXT NOT NULL,
  data TEXT NOT NULL);
CREATE TABLE block(seq INTEGER PRIMARY KEY, stream TEXT NOT NULL, step TEXT NOT NULL, frames INTEGER NOT NULL,
  first_s REAL NOT NULL, last_s REAL NOT NULL, crc INTEGER NOT NULL, data BLOB NOT NULL);
CREATE TABLE channel(id INTEGER PRIMARY KEY, name TEXT NOT NULL, unit TEXT NOT NULL);
CREATE TABLE reading(seq INTEGER PRIMARY KEY, at_s REAL NOT NULL, channel INTEGER NOT NULL, value REAL NOT NULL);
CREATE TABLE sample(seq INTEGER PRIMARY KEY, at_s REAL NOT NULL, stream TEXT NOT NULL, step TEXT NOT NULL,
  value REAL NOT NULL);
CREATE TABLE chain(number INTEGER PRIMARY KEY, journal INTEGER NOT NULL, block INTEGER NOT NULL,
  channel INTEGER NOT NULL, reading INTEGER NOT NULL, sample INTEGER NOT NULL, head BLOB NOT NULL);
"""


def create(path: Path) -> sqlite3.Connection:
    """Create a database in WAL mode with full synchronisation. Raises StoreError if it cannot.

    WAL with synchronous=FULL lost nothing in simulated power cuts. SQLite reports no error when a pragma fails, so the
    settings are read back.
    """
    try:
        with closed_on_error(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as database:
            _make_commits_durable(database, path)
            database.executescript(f"BEGIN; {_SCHEMA} PRAGMA user_version={VERSION}; COMMIT;")
            _extend(log_of(path))
    except (sqlite3.Error, OSError) as problem:
        raise StoreError(f"{path}: cannot be created ({problem})") from problem
    return database


def log_of(path: Path) -> Path:
    """Path of SQLite's log beside a database."""
    return path.with_name(f"{path.name}-wal")


def _extend(log: Path) -> None:
    """Append zeros to the log up to LOG_BYTES, because a commit that extends a file takes longer.

    SQLite ignores them. Closing the file releases no lock: in WAL mode, locks are on the index beside the log
    (https://www.sqlite.org/walformat.html#the_wal_index_file_format).
    """
    with log.open("ab") as file:
        file.write(bytes(LOG_BYTES - file.tell()))


def reopen(path: Path) -> sqlite3.Connection:
    """Open the database of an interrupted run for appending; SQLite recovers it. Raises StoreError as `create` does."""
    open_to_read(path).close()
    try:
        with closed_on_error(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as database:
            if (version := database.execute("PRAGMA user_version").fetchone()[0]) != VERSION:
                raise StoreError(f"{path}: has format {version}, this program appends to format {VERSION}")
            _make_commits_durable(database, path)
    except sqlite3.Error as problem:
        raise StoreError(f"{path}: cannot be opened ({problem})") from problem
    return database


def _make_commits_durable(database: sqlite3.Connection, path: Path) -> None:
    mode = database.execute("PRAGMA journal_mode=WAL").fetchone()[0]
    database.execute("PRAGMA synchronous=FULL")
    if mode != "wal" or database.execute("PRAGMA synchronous").fetchone()[0] != 2:
        raise StoreError(
            f"{path}: this file system does not support what a run store needs; use a local disk, not a network share"
        )


def make_one_file(database: sqlite3.Connection) -> None:
    """Move everything into the database file, and end the log, so that later readers create no other files.

    Where another program has the database open the log stays, empty. Raises sqlite3.Error if one reads so long that
    the log cannot be emptied.
    """
    database.execute("PRAGMA busy_timeout=500")
    try:
        database.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.OperationalError:
        database.execute("PRAGMA busy_timeout=5000")  # now for those that read at this moment
        busy, _, _ = database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if busy:
            raise


def open_to_read(path: Path) -> sqlite3.Connection:
    """Open an existing database for reading; SQLite recovers that of an interrupted run. Raises StoreError."""
    _expect_files(path)
    try:
        _roll_back(path)
        read_only = f"{path.absolute().as_uri()}?mode=ro"
        with closed_on_error(sqlite3.connect(read_only, uri=True, isolation_level=None)) as database:
            version = database.execute("PRAGMA user_version").fetchone()[0]
            if version == 0:
                raise StoreError(f"{path}: has no tables; {_why_empty(path)}")
            if version not in READABLE:
                raise StoreError(f"{path}: has format {version}, this program reads formats 1 to {VERSION}")
    except sqlite3.Error as problem:
        raise StoreError(f"{path}: cannot be read ({problem})") from problem
    return database


def _expect_files(path: Path) -> None:
    """Raise StoreError unless the database and SQLite's files beside it, if present, are regular files."""
    for each in (path, *(path.with_name(f"{path.name}-{beside}") for beside in ("wal", "shm", "journal"))):
        if each == path or each.exists():
            try:
                expect_bounded(each, sys.maxsize)
            except UnfitFileError as problem:
                raise StoreError(f"{each}: {problem}") from problem


def _why_empty(path: Path) -> str:
    """Return the reason why a database has no tables; its first rows are in the log beside it for a long time."""
    if not path.stat().st_size:
        return "it is empty: its content was deleted, or the run was killed before its first commit"
    log = log_of(path)
    if not log.exists() or (log.is_file() and not log.stat().st_size):  # SQLite makes an empty one
        return (
            f"there is no log {log.name} beside it: it was deleted, with all its rows, or the run was killed "
            "before its first commit"
        )
    return f"nothing can be read of the log {log.name} beside it"


def _roll_back(path: Path) -> None:
    """Roll back a transaction that a power cut interrupted at the end of a run; a read-only connection cannot."""
    if path.with_name(f"{path.name}-journal").exists():
        with closing(sqlite3.connect(path)) as database:
            database.execute("PRAGMA user_version").fetchone()


@contextmanager
def closed_on_error(database: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    """Close the database if the block raises; otherwise leave it open."""
    try:
        yield database
    except BaseException:
        database.close()
        raise
