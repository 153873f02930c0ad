"""What a guardian writes: to the run, to the records of this user, and to a person."""

from __future__ import annotations

import json
import threading
import time
from datetime import datetime

import pytest

from bench.clock import boot_id, since_boot_s, wall_utc
from bench.errors import StoreError
from bench.guardian import notes as module
from bench.guardian.notes import Notes


def lines_of(path):
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def test_an_entry_is_in_the_run_and_in_the_records_of_this_user(run, state):
    before, up_s = wall_utc(), since_boot_s()
    notes = Notes(run, "notes.jsonl", by="the guardian")
    notes.entry("begins", why="60 °C")
    notes.close()
    (entry,) = lines_of(run / "notes.jsonl")
    assert lines_of(state / "notes.jsonl") == [entry]
    assert "60 °C" in (run / "notes.jsonl").read_text("utf-8")
    at, entry_up_s = datetime.fromisoformat(entry.pop("at")), entry.pop("up_s")
    assert entry == {"boot": boot_id(), "run": str(run), "by": "the guardian", "event": "begins", "why": "60 °C"}
    assert abs((at - before).total_seconds()) < 5
    assert at.microsecond % 1000 == 0
    assert 0 <= entry_up_s - up_s + 0.001 < 5
    assert (type(entry_up_s), round(entry_up_s, 3)) == (float, entry_up_s)


def test_without_a_run_it_is_in_the_records_of_this_user(state):
    notes = Notes(None, "notes.jsonl")
    notes.entry("begins")
    notes.close()
    (entry,) = lines_of(state / "notes.jsonl")
    assert entry["run"] == ""


def test_a_run_that_is_gone_is_not_made_again(tmp_path, state):
    notes = Notes(tmp_path / "gone", "notes.jsonl")
    notes.entry("begins")
    notes.close()
    assert not (tmp_path / "gone").exists()
    assert len(lines_of(state / "notes.jsonl")) == 1


def test_a_run_that_takes_no_entry_leaves_it_in_the_records(run, state):
    (run / "notes.jsonl").mkdir()
    notes = Notes(run, "notes.jsonl")
    notes.entry("begins")
    notes.close()
    assert len(lines_of(state / "notes.jsonl")) == 1


def test_a_person_is_told_of_which_run(run, capfd):
    notes = Notes(run, "notes.jsonl")
    notes.line("the bench is safe.")
    notes.close()
    other = Notes(None, "notes.jsonl")
    other.line("60 °C")
    other.close()
    assert capfd.readouterr().err == "a run: the bench is safe.\n60 °C\n"


@pytest.mark.parametrize("problem", [OSError(), ValueError(), StoreError("no disk")])
def test_what_cannot_be_written_holds_up_nothing_else(problem):
    done: list[int] = []

    def fails() -> None:
        raise problem

    notes = Notes(None, "notes.jsonl")
    for work in (lambda: done.append(1), fails, lambda: done.append(2)):
        notes.do(work)
    notes.close()
    assert done == [1, 2]
    notes.do(lambda: done.append(3))  # more may follow
    notes.close()
    assert done == [1, 2, 3]


def test_a_blocked_terminal_holds_up_no_record_and_a_blocked_disk_only_for_a_while(run, monkeypatch):
    monkeypatch.setattr(module, "WRITTEN_WITHIN_S", 0.2)
    monkeypatch.setattr(module, "SHOWN_WITHIN_S", 0.1)
    free, done = threading.Event(), list[int]()
    monkeypatch.setattr(module, "_show", lambda _text: free.wait(5))
    notes = Notes(run, "notes.jsonl")
    notes.line("nobody reads this")
    notes.do(lambda: done.append(threading.current_thread().daemon))
    begun_s = time.monotonic()
    notes.close()
    assert done == [True]
    assert 0.1 <= time.monotonic() - begun_s < 2
    begun_s = time.monotonic()
    notes.do(lambda: free.wait(5))
    notes.close()
    assert 0.2 <= time.monotonic() - begun_s < 2
    free.set()
