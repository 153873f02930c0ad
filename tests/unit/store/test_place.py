"""Where a record is, wherever it is moved, and what is kept of one that is gone."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing

import pytest

from bench.errors import StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Valid
from bench.store import database
from bench.store.chain import Link, check_rows
from bench.store.place import RESCUED, Loss, WatchedFiles, rescue, rescue_database
from bench.store.user_state import state_folder
from bench.store.writer import RunWriter

NAMES = ("data", "log")


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "record"
    made.mkdir()
    for name in NAMES:
        (made / name).write_bytes(b"12345678")
    return made


@pytest.fixture
def watched(folder):
    found = WatchedFiles(folder, NAMES)
    yield found
    found.close()


def test_nothing_is_lost_of_a_record_that_is_there(watched, folder):
    assert (watched.lost(), watched.found()) == (None, folder)


def test_a_file_that_is_gone_or_replaced_is_named(watched, folder):
    other = folder / "other"
    other.write_bytes(b"another")
    other.rename(folder / "data")
    assert (watched.lost(), watched.found()) == (Loss(folder / "data"), None)
    (folder / "data").unlink()
    assert watched.lost() == Loss(folder / "data")
    (folder / "log").unlink()
    assert watched.lost() == Loss(folder)


def test_the_first_file_is_looked_at_each_time_and_the_others_every_second(watched, folder, monkeypatch):
    (folder / "log").unlink()
    assert watched.lost() is None
    monkeypatch.setattr("bench.store.place.LOOK_EVERY_S", 0.0)
    assert watched.lost() == Loss(folder / "log")


def test_a_folder_that_is_moved_is_lost_and_found(watched, folder):
    moved = folder.rename(folder.with_name("moved"))
    assert (watched.lost(), watched.found()) == (Loss(folder), moved)


def test_a_first_file_that_has_shrunk_is_named_until_it_has_grown_again(watched, folder):
    assert watched.lost() is None
    os.truncate(folder / "data", 7)
    assert watched.lost() == Loss(folder / "data", is_truncated=True)
    assert watched.lost() == Loss(folder / "data", is_truncated=True)
    os.truncate(folder / "data", 9)
    assert watched.lost() is None
    os.truncate(folder / "log", 0)
    assert watched.lost() is None


def test_who_has_closed_it_finds_it_no_more(watched, folder):
    watched.close()
    watched.close()
    assert watched.found() is None


@pytest.fixture
def record(tmp_path):
    """The database of a run of five readings, and its last link."""

    async def main() -> None:
        writer = RunWriter(tmp_path)
        writer.readings("air", "°C", [Valid(float(second), 20.0, 1) for second in range(5)])
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    with closing(sqlite3.connect(tmp_path / database.FILE_NAME)) as opened:
        last = check_rows(opened).intact
        assert last is not None
        yield opened, last


def test_what_is_still_open_is_copied(record):
    opened, last = record
    folder = rescue_database(opened, "a run", "copy", last)
    assert folder == state_folder() / RESCUED / "a run"
    with closing(sqlite3.connect(folder / "copy")) as copy:
        assert copy.execute("SELECT COUNT(*) FROM reading").fetchone() == (5,)
        assert copy.execute("PRAGMA journal_mode").fetchone() == ("delete",)


def test_a_copy_that_ends_before_the_last_link_is_not_all(record):
    opened, last = record
    further = Link(last.number + 1, last.rows, b"\0" * 32)
    with pytest.raises(StoreError) as found:
        rescue_database(opened, "a run", "copy", further)
    file = state_folder() / RESCUED / "a run" / "copy"
    assert str(found.value) == (
        f"not all of it could be kept: {file} is a copy of what could be read, intact up to row {last.total} of "
        f"{last.total}"
    )


def test_a_damaged_one_is_intact_up_to_its_damage(record):
    opened, last = record
    opened.execute("UPDATE reading SET value = 21 WHERE seq = 3")
    opened.commit()
    with pytest.raises(StoreError, match=rf"intact up to row 0 of {last.total}$"):
        rescue_database(opened, "a run", "copy", last)


def test_what_is_no_chain_is_intact_up_to_nothing(record):
    opened, last = record
    opened.execute(f"DELETE FROM {database.CHAIN}")
    opened.commit()
    with pytest.raises(StoreError, match=rf"intact up to row 0 of {last.total}$"):
        rescue_database(opened, "a run", "copy", last)


def test_where_nothing_can_be_written_nothing_is_kept(record):
    opened, _ = record
    (state_folder() / RESCUED).write_text("in the way")
    with pytest.raises(StoreError, match=r"^nothing of it could be kept \("):
        rescue(opened, "a run", "copy")
