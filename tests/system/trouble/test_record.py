"""What is on the disk of a run, and when."""

import os
import shutil
import threading
from pathlib import Path

import pytest

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.errors import StoreError
from bench.loop import REAL_TIME
from bench.loop import run as run_loop
from bench.reduce.stored_run import open_run
from bench.report.revision import examined, verify
from bench.report.write import write_report
from bench.runner.quiet import Quiet
from bench.store import database
from bench.store.reader import RunReader
from bench.store.user_state import state_folder
from bench.store.writer import RunWriter
from tests.support.runs import ROOT, read_json, run_short

INPUTS = {"manifest.json", "sequence.yaml", "bench.yaml", "if_counter.dbc"}


@pytest.fixture
def synced(monkeypatch):
    """Inodes that were synchronised, each with the names that a folder had then."""
    found: dict[int, set[str]] = {}
    really = os.fsync

    def fsync(handle: int) -> None:
        place = Path(os.readlink(f"/proc/self/fd/{handle}"))
        found[os.fstat(handle).st_ino] = set(os.listdir(place)) if place.is_dir() else set()
        really(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    return found


def test_inputs_and_every_folder_that_leads_to_them_are_durable_before_the_first_entry(tmp_path, synced, monkeypatch):
    before: dict[int, set[str]] = {}
    really = RunWriter.event

    def first(self, kind, step="", **data):
        if not before:
            before.update(synced)
        really(self, kind, step, **data)

    monkeypatch.setattr(RunWriter, "event", first)
    result = run_short(tmp_path / "new" / "runs", sequence="smoke", bench=ROOT / "config" / "simulated.yaml")
    opening = before[result.path.stat().st_ino]
    assert opening >= INPUTS
    for path in (result.path / name for name in INPUTS - {"manifest.json"}):
        assert path.stat().st_ino in before, path.name
        assert path.stat().st_size
    assert result.path.name in before[result.path.parent.stat().st_ino]
    assert "runs" in before[(tmp_path / "new").stat().st_ino]
    assert "new" in before[tmp_path.stat().st_ino]


class Meddler(Quiet):
    """Does something to the directory of a run when its fifth step begins."""

    def __init__(self, meddle):
        super().__init__()
        self._meddle, self._folder = meddle, None

    def run_begins(self, path, expected, clock):
        self._folder = path
        super().run_begins(path, expected, clock)

    def step_begins(self, planned, index):
        if index == 4:
            self._meddle(self._folder)
        super().step_begins(planned, index)


def meddled(runs, meddle):
    return execute(prepare(RunRequest("smoke", runs=runs, operator="A. Technician")), Meddler(meddle))


def is_kept(result, folder):
    """A run that ended there, with its journal up to its teardown, its inputs, a seal and a report."""
    assert (result.path, result.outcome.how, result.outcome.unsafe) == (folder, "error", {})
    record = examined(folder)
    assert (record.kind, record.damage) == ("sealed", ())
    with RunReader(folder) as reader:
        begun = [event.step for event in reader.events("step_begins")]
    assert len(begun) >= 5
    assert {path.name for path in folder.iterdir()} >= INPUTS | {"run.db", "seal.json", "report.html"}


def test_a_run_follows_its_directory_when_that_is_moved_and_ends(tmp_path):
    result = meddled(tmp_path / "runs", lambda folder: folder.parent.rename(tmp_path / "archive"))
    is_kept(result, tmp_path / "archive" / result.path.name)
    assert f"was moved to {result.path}" in result.problems[0]


def test_what_was_recorded_is_rescued_when_the_directory_is_removed(tmp_path):
    result = meddled(tmp_path / "runs", lambda folder: shutil.rmtree(folder.parent))
    is_kept(result, state_folder() / "rescued" / result.path.name)
    assert "was removed during the run" in result.problems[0]
    assert f"recorded until then is in {result.path}" in result.problems[0]


@pytest.mark.parametrize("name", ["sequence.yaml", "bench.yaml", "if_counter.dbc"])
def test_an_input_that_is_edited_while_the_run_goes_on_does_not_pass_for_what_was_run(tmp_path, name):
    def edit(folder):
        with (folder / name).open("ab") as file:
            file.write(b"\n")

    result = meddled(tmp_path / "runs", edit)
    changed = f"{result.path / name}: has changed since it was written"
    assert any(changed in each for each in result.outcome.problems)
    assert "The run is not reduced" in result.problems[0]
    assert read_json(result, "manifest.json")["verdict"] == "ERROR"
    assert changed in verify(result.path)


@pytest.mark.parametrize("size", [0, 10_000_000])
def test_another_file_in_the_place_of_the_database_is_not_taken_for_it(tmp_path, size):
    def replace(folder):
        (folder / "run.db").unlink()
        (folder / "run.db").write_bytes(bytes(size))

    result = meddled(tmp_path / "runs", replace)
    is_kept(result, state_folder() / "rescued" / result.path.name)


def test_a_run_whose_log_is_removed_does_not_go_on_without_it(tmp_path, monkeypatch):
    """What is committed to a log without a name would be lost with the process."""
    monkeypatch.setattr("bench.store.place.LOOK_EVERY_S", 0.0)  # this run takes a fraction of a second
    result = meddled(tmp_path / "runs", lambda folder: (folder / "run.db-wal").unlink())
    is_kept(result, state_folder() / "rescued" / result.path.name)
    assert "run.db-wal was removed during the run" in result.problems[0]


def test_a_run_whose_database_is_truncated_ends_with_what_was_recorded(tmp_path):
    """What its log still has is copied; the rest of the record would have been written into an empty file."""
    result = meddled(tmp_path / "runs", lambda folder: os.truncate(folder / "run.db", 0))
    is_kept(result, state_folder() / "rescued" / result.path.name)
    assert "run.db was truncated during the run; everything recorded until then is in" in result.problems[0]


@pytest.mark.parametrize("size", [0, 4096, 1_000_000])
def test_a_truncated_database_of_which_the_log_has_only_the_end_is_not_said_to_be_kept(tmp_path, size):
    folder, failures = tmp_path / "run", []
    folder.mkdir()
    writer = long_written(folder)
    writer.on_failure = lambda failure: failures.append(str(failure))
    os.truncate(folder / "run.db", size)
    with pytest.raises(StoreError, match="was truncated during the run; not all"):
        run_loop(writer.commit(), REAL_TIME)
    assert len(failures) == 1
    assert writer.folder == folder
    (copy,) = (state_folder() / "rescued/run").iterdir()
    assert f"{copy} is a copy of what could be read, intact up to row " in failures[0]
    with pytest.raises(StoreError, match="was truncated"):
        writer.close()


def test_a_run_whose_record_is_lost_by_truncation_ends_safe_and_says_what_is_left(tmp_path, monkeypatch):
    really = database._make_commits_durable

    def to_the_file_at_once(opened, path):
        really(opened, path)
        opened.execute("PRAGMA wal_autocheckpoint=1")
        opened.execute("PRAGMA cache_size=1")

    monkeypatch.setattr(database, "_make_commits_durable", to_the_file_at_once)
    result = meddled(tmp_path / "runs", lambda folder: os.truncate(folder / "run.db", 0))
    assert (result.outcome.how, result.outcome.unsafe) == ("error", {})
    assert "run.db was truncated during the run; not" in result.problems[0]
    assert result.path.parent == tmp_path / "runs"
    assert examined(result.path).damage


def long_written(folder):
    """A writer whose log was begun anew several times, as after hours."""
    writer = RunWriter(folder, noted=False)

    async def write():
        for _ in range(40):
            for number in range(200):
                writer.event("note", text=f"{number}" * 500)
            await writer.commit()

    run_loop(write(), REAL_TIME)
    return writer


def test_a_report_of_which_the_list_says_nothing_is_not_as_it_was_written(smoke_copy):
    folder = smoke_copy
    report = folder / "report.html"
    report.write_text(report.read_text("utf-8").replace("PASS", "FAIL"), "utf-8")
    (folder / "report_revisions.json").unlink()
    assert verify(folder) == [
        f"{report}: is not in report_revisions.json; 'bench report {folder.name}' writes it again"
    ]
    with open_run(folder) as run:
        write_report(run)
    (folder / "report.docx").write_bytes(b"somebody's own")
    assert verify(folder) == []


def test_where_nothing_can_be_kept_the_run_ends_in_words(tmp_path, monkeypatch):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    result = meddled(tmp_path / "runs", lambda folder: shutil.rmtree(folder.parent))
    assert (result.outcome.how, result.outcome.unsafe) == ("error", {})
    assert "was removed during the run; nothing of it could be kept" in result.problems[0]


@pytest.mark.integration
def test_a_run_that_gives_nothing_is_told_when_its_directory_is_removed(tmp_path):
    """Nothing is given or committed meanwhile that could fail: the store tells it by itself."""
    folder, reported, failures = tmp_path / "run", threading.Event(), []
    folder.mkdir()
    writer = RunWriter(folder)

    def failed(failure):
        failures.append(str(failure))
        reported.set()

    writer.on_failure = failed
    shutil.rmtree(folder)
    assert reported.wait(10.0)
    assert "was removed during the run" in failures[0]
    with pytest.raises(StoreError, match="was removed"):
        writer.close()


def written(name, text):
    """What puts a file into the directory of a run."""
    return lambda folder: (folder / name).write_text(text, "utf-8")


@pytest.mark.parametrize("name", ["notes.txt", "another.dbc", "called/notes.txt"])
def test_a_file_that_somebody_adds_while_the_run_goes_on_is_not_under_its_seal(tmp_path, name):
    def add(folder):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("looked at by A.")

    result = meddled(tmp_path / "runs", add)
    assert result.results.verdict == "PASS"
    assert name not in read_json(result, "seal.json")["files"]
    record = examined(result.path)
    assert (record.kind, record.damage, record.remarks) == ("sealed", (), (f"not covered by the seal: {name}",))


@pytest.mark.parametrize("edit", [written("manifest.json", "{}"), lambda folder: (folder / "manifest.json").unlink()])
def test_a_manifest_that_is_edited_while_the_run_goes_on_is_on_record(tmp_path, edit):
    result = meddled(tmp_path / "runs", edit)
    reported = f"{result.path / 'manifest.json'}: another program wrote or removed this file during the run"
    assert result.problems[0].startswith(reported)
    manifest = read_json(result, "manifest.json")
    assert (manifest["problems"], manifest["verdict"]) == (result.problems, "PASS")
    assert examined(result.path).damage == ()


def test_a_manifest_that_is_edited_while_the_run_goes_on_is_kept_beside(tmp_path):
    result = meddled(tmp_path / "runs", written("manifest.json", "mine"))
    assert (result.path / "manifest.json.found").read_text() == "mine"
    assert examined(result.path).remarks == ("not covered by the seal: manifest.json.found",)


@pytest.mark.parametrize("name", ["truth.json", "results.json"])
def test_a_file_in_the_place_of_a_result_is_kept_beside_and_told(tmp_path, name):
    result = meddled(tmp_path / "runs", written(name, "mine"))
    assert (result.path / f"{name}.found").read_text() == "mine"
    assert (read_json(result, "manifest.json")["problems"], len(result.problems)) == (result.problems, 1)
    assert f"{name}: another program wrote" in result.problems[0]
    assert examined(result.path).damage == ()
