"""The database of a run: what is no database, or has lost its rows, is told for what it is."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench.errors import StoreError
from bench.store import database
from bench.store.database import compressed, open_to_read, plain_bytes, plain_of, reopen
from drivers.can.frame_block import FrameBlock


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


BLOCK = FrameBlock(np.zeros(3, np.uint32), np.arange(3.0), np.full(3, 8, np.uint8), np.zeros((3, 8), np.uint8))


def test_a_block_is_read_as_it_was_packed_or_told_as_damaged():
    plain = plain_bytes(BLOCK)
    data, crc = compressed(plain)
    assert plain_of(data, 3, crc) == plain
    for given in (("text", 3, crc), (data, "3", crc), (data, -1, crc), (data, 10**9, crc)):
        assert told(plain_of, *given) == f"a block of {given[1]} frames is damaged"
    wrong = "a block of {} frames is damaged: its checksum is wrong"
    assert told(plain_of, data, 3, crc + 1) == wrong.format(3)
    assert told(plain_of, data, 2, crc) == wrong.format(2)
    assert told(plain_of, data[:-9], 3, crc).startswith("a block of 3 frames is damaged")
    assert told(plain_of, b"\xff" * 90, 3, crc).startswith("a block of 3 frames is damaged (")
