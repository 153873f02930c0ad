"""The register of benches that may be energised."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from bench.errors import StoreError
from bench.store.energised import FOLDER, MADE_SAFE, energised, note_energised, note_safe, record_made_safe
from bench.store.user_state import state_folder

SUPPLY, SOURCE = "tcp://10.0.0.1:5025", "serial:///dev/ttyUSB0"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return state_folder() / FOLDER


def note(run: str, hour: int = 1, **connections: str) -> None:
    note_energised(Path(run), Path("/bench.yaml"), datetime(2026, 1, 1, hour, tzinfo=UTC), connections)


def left() -> list[tuple[str, dict[str, str]]]:
    return [(Path(each.run).name, dict(each.connections)) for each in energised(pytest.fail)]


def test_a_run_is_there_until_all_its_instruments_are_safe():
    note("runs/a", supply=SUPPLY, source=SOURCE)
    assert left() == [("a", {"supply": SUPPLY, "source": SOURCE})]
    note_safe([SUPPLY])
    assert left() == [("a", {"source": SOURCE})]
    note_safe([SOURCE, SUPPLY])
    assert left() == []


def test_the_oldest_run_comes_first_and_a_safe_instrument_is_safe_for_all():
    note("runs/b", 2, supply=SUPPLY)
    note("runs/a", 3, supply=SUPPLY, source=SOURCE)
    assert [run for run, _ in left()] == ["b", "a"]
    note_safe([SUPPLY])
    assert left() == [("a", {"source": SOURCE})]


def test_runs_of_one_name_in_two_folders_have_an_entry_each():
    note("one/a", 1, supply=SUPPLY)
    note("two/a", 2, source=SOURCE)
    assert left() == [("a", {"supply": SUPPLY}), ("a", {"source": SOURCE})]


@pytest.mark.parametrize(
    "content", ["", "{", "[]", '{"schema": "itb-energised/1"}', '{"schema": "itb-energised/9"}', "\0"]
)
def test_an_entry_that_cannot_be_read_is_reported_and_hides_no_other(folder, content):
    note("runs/a", supply=SUPPLY)
    (folder / "0.json").write_text(content, "utf-8")
    problems: list[StoreError] = []
    assert [Path(each.run).name for each in energised(problems.append)] == ["a"]
    assert len(problems) == 1
    assert str(folder / "0.json") in str(problems[0])
    note_safe([SUPPLY])
    assert [path.name for path in folder.iterdir()] == ["0.json"]


def test_a_folder_that_cannot_be_made_is_an_error_in_words(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with pytest.raises(StoreError, match="register of energised benches cannot be used"):
        note("runs/a", supply=SUPPLY)


def test_how_a_bench_was_made_safe_by_hand_is_appended(tmp_path):
    for role in ("supply", "°"):
        record_made_safe(tmp_path / "bench.yaml", datetime(2026, 1, 1, tzinfo=UTC), [{"role": role, "state": "safe"}])
    lines = (state_folder() / MADE_SAFE).read_text("utf-8").splitlines()
    assert [json.loads(line) for line in lines] == [
        {"bench": str(tmp_path / "bench.yaml"), "at": "2026-01-01T00:00:00+00:00",
         "lanes": [{"role": role, "state": "safe"}]}
        for role in ("supply", "°")
    ]  # fmt: skip
    assert "°" in lines[1]


def test_that_it_cannot_be_appended_is_told(tmp_path):
    (state_folder() / MADE_SAFE).mkdir()
    with pytest.raises(StoreError, match=r"^how the bench was made safe cannot be recorded \("):
        record_made_safe(tmp_path / "bench.yaml", datetime(2026, 1, 1, tzinfo=UTC), [])


def test_that_the_folder_of_all_users_is_out_of_reach_is_told(monkeypatch):
    note("runs/a", supply=SUPPLY)
    monkeypatch.setattr("bench.store.energised.problem_to_read", lambda: "this user may not read it")
    problems: list[StoreError] = []
    assert [Path(each.run).name for each in energised(problems.append)] == ["a"]
    (problem,) = problems
    assert str(problem) == "what runs of other users have left on is not known: this user may not read it"
