"""The database of a run: what is no database, or has lost its rows, is told for what it is."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from bench.errors import StoreError
from bench.store import database
from bench.store.database import open_to_read, reopen


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / database.FILE_NAME


def told(act, *arguments: object) -> str:
    with pytest.raises(StoreError) as found:
        act(*arguments)
    return str(found.value)


def test_commits_go_through_a_log_and_are_synchronised(path):
    with closing(database.create(path)) as made:
        assert made.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert made.execute("PRAGMA synchronous").fetchone() == (2,)
        database.make_one_file(made)
        assert made.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    assert [each.name for each in path.parent.iterdir()] == [database.FILE_NAME]
    with closing(reopen(path)) as again:
        assert again.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert again.execute("PRAGMA synchronous").fetchone() == (2,)


def test_an_empty_file_was_emptied_or_killed_early(path):
    path.touch()
    why = "it is empty: its content was deleted, or the run was killed before its first commit"
    assert told(open_to_read, path) == f"{path}: has no tables; {why}"


def without_tables(path: Path) -> None:
    with closing(sqlite3.connect(path)) as made:
        made.execute("PRAGMA application_id=1")
        made.commit()


def test_one_without_its_log_says_so(path):
    without_tables(path)
    why = (
        "there is no log run.db-wal beside it: it was deleted, with all its rows, or the run was killed "
        "before its first commit"
    )
    assert told(open_to_read, path) == f"{path}: has no tables; {why}"


def test_one_whose_log_is_unreadable_says_so(path):
    without_tables(path)
    path.with_name("run.db-wal").write_bytes(b"no log" * 100)
    assert told(open_to_read, path) == f"{path}: has no tables; nothing can be read of the log run.db-wal beside it"


def test_one_of_another_format_is_refused(path):
    database.create(path).close()
    with closing(sqlite3.connect(path)) as made:
        made.execute("PRAGMA user_version=1")
    assert told(reopen, path) == f"{path}: has format 1, this program appends to format {database.VERSION}"
    with closing(sqlite3.connect(path)) as made:
        made.execute("PRAGMA user_version=99")
    assert told(open_to_read, path) == f"{path}: has format 99, this program reads formats 1 to {database.VERSION}"


def test_what_is_no_database_is_not_read(path):
    path.write_bytes(b"no database" * 500)
    assert told(open_to_read, path) == f"{path}: cannot be read (file is not a database)"
    assert told(open_to_read, path.with_name("gone")).startswith(f"{path.with_name('gone')}: ")


def test_a_commit_overwrites_the_log_and_does_not_make_it_longer(path):
    log = path.with_name(database.LOG_NAME)
    with closing(database.create(path)) as made:
        assert log.stat().st_size == database.LOG_BYTES
        for number in range(1500):  # SQLite begins its log anew after 1000 pages
            made.execute("INSERT INTO journal VALUES (?, 0.0, '', '', '{}')", (number,))
        used = len(log.read_bytes().rstrip(b"\0"))
        assert (log.stat().st_size, used > 0.9 * database.LOG_BYTES) == (database.LOG_BYTES, True)
