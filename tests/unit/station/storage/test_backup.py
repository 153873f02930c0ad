"""Backups: complete, of one instant, refused where they would do harm, and begun by nobody after a restoration."""

import asyncio
import io
import os
import shutil
import tarfile
import threading

import pytest

from bench.errors import BenchError, InputError, StoreError
from bench.station.prepare.texts import Texts
from bench.station.queue.attempts import claim, prepare
from bench.station.queue.items import ItemState, Submission
from bench.station.queue.table import Queue
from bench.station.settings import read_station
from bench.station.storage import backup, snapshots
from bench.station.storage.backup import back_up, restore
from bench.station.storage.database import FILE_NAME, Database
from bench.station.storage.snapshots import Snapshots, snapshot
from tests.support.runs import ROOT

WAITING = frozenset({ItemState.QUEUED})


@pytest.fixture
def station(tmp_path):
    """A folder with two items, of which the first has begun."""
    folder = tmp_path / "station"
    database = Database(folder)
    queue = Queue(database)
    first = queue.submit(Submission(sequence="smoke", bench="demo"), "anna")
    queue.submit(Submission(sequence="smoke", bench="demo"), "anna")
    attempt = folder / "items" / first.id / "1"
    prepare(attempt, ["run", "smoke"], tmp_path)
    claim(attempt)
    prepare(attempt.with_name("2"), ["run", "smoke"], tmp_path)  # of an instant after the copy of the database
    queue.change(first.id, WAITING, state=ItemState.STARTING, attempts=1)
    database.close()
    for name in ("token", "station.json"):
        (folder / name).write_text("secret")
    (folder / "limits.json").write_text("{}")
    return folder


def items(folder):
    database = Database(folder)
    try:
        queue = Queue(database)
        return queue.items(), queue.stopped("demo")
    finally:
        database.close()


@pytest.mark.parametrize("ending", ["tar.xz", "tar.gz"])
def test_a_restored_station_has_all_items_and_begins_none_until_a_person_lets_it(station, tmp_path, ending):
    before, stopped = items(station)
    assert stopped == ""
    back_up(station, out := tmp_path / f"kept.{ending}", print)
    assert out.stat().st_mode & 0o777 == 0o600
    assert restore(out, tmp_path / "again").benches == ["demo"]
    found, stopped = items(tmp_path / "again/station")
    assert found == before
    assert "see which items have run since" in stopped


def test_sequences_of_the_station_are_kept_with_their_versions(station, tmp_path):
    texts = Texts(read_station(None, station, runs=tmp_path / "runs"))
    texts.save("mine", "title: first\n", "", "ann", "begun")
    back_up(station, out := tmp_path / "kept.tar.xz", print)
    restore(out, tmp_path / "again")
    again = Texts(read_station(None, tmp_path / "again/station", runs=tmp_path / "runs"))
    assert again.versions("mine") == texts.versions("mine")
    again.save("mine", "title: second\n", again.text("mine").digest, "ann", "goes on")
    assert len(again.versions("mine")) == 2


def test_a_backup_has_the_attempts_of_its_instant_and_no_token(station, tmp_path):
    back_up(station, out := tmp_path / "kept.tar.xz", print)
    restore(out, again := tmp_path / "again")
    (attempt,) = (again / "station/items").glob("*/*")
    assert sorted(path.name for path in attempt.iterdir()) == ["claim", "command.json"]
    assert attempt.name == "1"
    assert {path.name for path in (again / "station").iterdir()} == {FILE_NAME, "items", "limits.json"}
    assert (again / "station").stat().st_mode & 0o777 == 0o700
    assert list((station / snapshots.FOLDER).iterdir()) == []


def test_settings_are_kept_with_the_files_that_they_name(station, tmp_path):
    for name in ("config", "sequences"):
        shutil.copytree(ROOT / name, tmp_path / "lab" / name)
    far = shutil.copytree(ROOT / "config", tmp_path / "far") / "gyro.yaml"
    file = tmp_path / "lab/station.yaml"
    benches = f"{{a: {{file: config/simulated.yaml}}, b: {{file: {far}}}, c: {{file: rate_table}}}}"
    file.write_text(f"schema: itb-station/1\nbenches: {benches}\nsequences: sequences\n")
    said = []
    back_up(station, out := tmp_path / "kept.tar.gz", said.append, settings=file)
    again = tmp_path / "again"
    assert restore(out, again).settings == again / "settings/station.yaml"
    kept = {str(path.relative_to(again / "settings")) for path in (again / "settings").rglob("*") if path.is_file()}
    assert {"station.yaml", "config/simulated.yaml", "config/if_counter.dbc", "sequences/smoke.yaml"} <= kept
    assert {name for name in kept if name.endswith("/rate_table.yaml")} == set()  # a shipped one
    assert f"{far}: left out, because it is not in {file.parent}; keep a copy of it" in said
    assert (
        read_station(again / "settings/station.yaml", again).benches["a"].read_bytes()
        == file.with_name("config").joinpath("simulated.yaml").read_bytes()
    )


def test_a_station_at_work_makes_the_copy_itself(station, tmp_path):
    database = Database(station)
    made = []

    async def main():
        working = asyncio.create_task(Snapshots(database).work())
        await asyncio.to_thread(back_up, station, tmp_path / "kept.tar.gz", made.append)
        working.cancel()

    try:
        asyncio.run(main())
    finally:
        database.close()
    assert len(items(restored(tmp_path / "kept.tar.gz", tmp_path / "again"))[0]) == 2


def test_a_station_that_hangs_is_named_and_nothing_is_left(station, tmp_path, monkeypatch):
    monkeypatch.setattr(snapshots, "ANSWERS_WITHIN_S", 0.2)
    database = Database(station)
    try:
        with pytest.raises(BenchError, match=r"has made no copy of its database within 0\.2 s"):
            back_up(station, tmp_path / "kept.tar.xz", print)
    finally:
        database.close()
    assert list((station / snapshots.FOLDER).iterdir()) == []
    assert not (tmp_path / "kept.tar.xz").exists()


def test_changes_while_the_copy_is_made_are_in_it_or_not_but_never_half(station):
    database = Database(station)
    queue, snaps, stop = Queue(database), Snapshots(database), threading.Event()
    copies = []

    def ask():
        while not stop.is_set():
            copies.append(snapshot(station))

    async def main():
        asking = threading.Thread(target=ask)
        asking.start()
        working = asyncio.create_task(snaps.work())
        for number in range(60):
            with database.transaction():
                queue_item = queue.item(queue.items()[0].id)
            queue.change(queue_item.id, frozenset(ItemState), attempts=number, reason=f"{number}")
            snaps.wake()
            await asyncio.sleep(0.01)
        stop.set()
        await asyncio.to_thread(asking.join)
        working.cancel()

    try:
        asyncio.run(main())
    finally:
        stop.set()
        database.close()
    assert len(copies) >= 2
    for number, copy in enumerate(copies):
        folder = station.parent / f"copy{number}"
        folder.mkdir()
        copy.rename(folder / FILE_NAME)
        found = next(each for each in items(folder)[0] if each.state is ItemState.STARTING)
        assert found.reason in ("", f"{found.attempts}")


def restored(archive, folder):
    restore(archive, folder)
    return folder / "station"


@pytest.mark.parametrize("where", ["", "station", "again"])
def test_a_folder_with_something_in_it_is_refused(station, tmp_path, where):
    back_up(station, out := tmp_path / "kept.tar.gz", print)
    (tmp_path / "again").mkdir()
    (tmp_path / "again/notes.txt").write_text("mine")
    with pytest.raises(InputError, match="name a new or empty folder"):
        restore(out, tmp_path / where)
    assert (tmp_path / "again/notes.txt").read_text() == "mine"


def test_an_empty_folder_is_used_and_a_failure_leaves_nothing(station, tmp_path):
    back_up(station, out := tmp_path / "kept.tar.xz", print)
    cut = tmp_path / "cut.tar.xz"
    cut.write_bytes(out.read_bytes()[:-200])
    (tmp_path / "again").mkdir()
    with pytest.raises(InputError, match="cannot be read as a backup"):
        restore(cut, tmp_path / "again")
    assert not (tmp_path / "again/station").exists()
    assert not (tmp_path / "again.draft").exists()
    assert restore(out, tmp_path / "again").benches == ["demo"]


@pytest.mark.parametrize(
    ("name", "what"), [("../../evil", "file"), ("/tmp/evil-of-a-backup", "file"), ("link", "link"), ("pipe", "pipe")]
)
@pytest.mark.parametrize("has_filters", [True, False])
def test_an_archive_of_an_attacker_writes_nothing_outside(tmp_path, monkeypatch, name, what, has_filters):
    if not has_filters:  # as in Python 3.11.2
        monkeypatch.delattr(tarfile, "data_filter", raising=False)
    out = tmp_path / "evil.tar.gz"
    with tarfile.open(out, "w:gz") as archive:
        entry = tarfile.TarInfo(name)
        entry.type = {"file": tarfile.REGTYPE, "link": tarfile.SYMTYPE, "pipe": tarfile.FIFOTYPE}[what]
        entry.linkname = "/etc" if what == "link" else ""
        archive.addfile(entry, io.BytesIO())
    with pytest.raises(InputError):
        restore(out, tmp_path / "deep/er/again")
    assert not any(path.name.startswith("evil-of") for path in (tmp_path.parent, tmp_path))
    assert not os.path.lexists("/tmp/evil-of-a-backup")
    assert not (tmp_path / "deep/er/again").exists()


def test_what_is_no_station_is_refused(station, tmp_path):
    with pytest.raises(InputError, match="is not the folder of a station"):
        back_up(tmp_path, tmp_path / "kept.tar.xz", print)
    assert not (tmp_path / FILE_NAME).exists()
    with pytest.raises(InputError, match=r"ends in \.tar\.xz or \.tar\.gz"):
        back_up(station, tmp_path / "kept.zip", print)
    with pytest.raises(InputError, match="outside of the folder"):
        back_up(station, station / "kept.tar.xz", print)
    back_up(station, tmp_path / "kept.tar.xz", print)
    with pytest.raises(InputError, match="is there already"):
        back_up(station, tmp_path / "kept.tar.xz", print)


def test_a_damaged_database_is_not_passed_on(station, tmp_path):
    data = bytearray((station / FILE_NAME).read_bytes())
    data[4096:8192] = os.urandom(4096)
    (station / FILE_NAME).write_bytes(data)
    with pytest.raises(StoreError):
        back_up(station, tmp_path / "kept.tar.xz", print)
    assert not (tmp_path / "kept.tar.xz").exists()


def test_a_form_of_another_version_is_named(station, tmp_path, monkeypatch):
    monkeypatch.setattr(backup, "SCHEMA", "itb-backup/9")
    back_up(station, out := tmp_path / "kept.tar.gz", print)
    monkeypatch.undo()
    with pytest.raises(InputError, match="has the form itb-backup/9"):
        restore(out, tmp_path / "again")
