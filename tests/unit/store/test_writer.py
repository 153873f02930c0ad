"""A writer that goes on with an interrupted run, stops, waits for a slow disk, or loses its folder."""

from __future__ import annotations

import asyncio
import math
import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.errors import StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Valid
from bench.store import database, ledger
from bench.store import writer as module
from bench.store.chain import HEAD_BYTES, NOTHING, Link
from bench.store.reader import RunReader
from bench.store.runs import MANIFEST
from bench.store.user_state import state_folder
from bench.store.verify import examine
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def folder(tmp_path) -> Path:
    made = tmp_path / "a run"
    made.mkdir()
    (made / MANIFEST).write_text('{"state": "running", "run": "a run", "units": []}', "utf-8")
    return made


FRAMES = FrameBlock(np.zeros(3, np.uint32), np.arange(3.0), np.full(3, 8, np.uint8), np.zeros((3, 8), np.uint8))


def played(act: Any) -> None:
    """Play what uses a writer, in an ordinary loop of a few milliseconds."""
    asyncio.run(act())


def air(*values: float) -> list[Valid]:
    return [Valid(float(second), value, 1) for second, value in enumerate(values)]


def killed(folder: Path, tmp_path: Path) -> Path:
    """What is left of a run that was killed after two readings."""
    left = tmp_path / "killed" / folder.name

    async def main() -> None:
        writer = RunWriter(folder)
        writer.readings("air", "°C", air(20.0, 21.0))
        await writer.commit()
        shutil.copytree(folder, left)
        writer.close()

    played(main)
    return left


def test_a_run_that_goes_on_has_the_channels_and_the_chain_of_before(folder, tmp_path):
    left = killed(folder, tmp_path)

    async def main() -> None:
        writer = RunWriter(left, resumed=True)
        writer.readings("air", "°C", air(22.0))
        writer.readings("supply", "V", air(15.0))
        await writer.commit()
        writer.close()

    played(main)
    with RunReader(left) as reader:
        assert reader.series("air").values.tolist() == [20.0, 21.0, 22.0]
        assert reader.series("supply").values.tolist() == [15.0]
    assert examine(left).damage == ()


def test_one_whose_manifest_is_another_does_not_go_on(folder, tmp_path):
    left = killed(folder, tmp_path)
    (left / MANIFEST).write_text("{}", "utf-8")
    with pytest.raises(StoreError) as found:
        RunWriter(left, resumed=True)
    assert str(found.value) == (
        f"{left}: the run store cannot write (the manifest is not the one that the run began with)"
    )


def test_whatever_stops_the_thread_is_told_to_who_waits(folder, monkeypatch):
    async def main() -> None:
        writer = RunWriter(folder)
        monkeypatch.setattr(writer, "_write", lambda *_: (_ for _ in ()).throw(MemoryError("none left")))
        writer.event("lost")
        for _ in range(2):
            with pytest.raises(StoreError, match=r"^the run store has stopped \(MemoryError\('none left'\)\)$"):
                await writer.commit()
        with pytest.raises(StoreError, match=r"^the run store has stopped"):
            writer.close()

    played(main)


def test_a_disk_that_takes_nothing_is_told_in_time(folder, monkeypatch):
    monkeypatch.setattr(module, "WAITING_LIMIT", 10)
    limits_s: list[float] = []

    def never(_wait: object, limit_s: float) -> bool:
        limits_s.append(limit_s)
        return False

    async def main() -> None:
        writer = RunWriter(folder)
        monkeypatch.setattr(module, "succeeded_within", never)
        monkeypatch.setattr(writer, "_waiting", 11)
        with pytest.raises(StoreError, match=r"^the disk has accepted no data for 30 s; is it failing or full\?$"):
            writer.event("too much")
        writer._waiting = 0
        writer.close()

    played(main)
    assert limits_s == [30.0]


def test_a_disk_that_is_slow_is_waited_for(folder, monkeypatch):
    monkeypatch.setattr(module, "WAITING_LIMIT", 5)

    async def main() -> None:
        writer = RunWriter(folder)
        for number in range(50):
            writer.event("step", str(number))
        await writer.commit()
        writer.close()

    played(main)
    with RunReader(folder) as reader:
        assert [(event.seq, event.step) for event in reader.events()] == [(n + 1, str(n)) for n in range(50)]


def test_what_is_no_number_is_not_stored(folder):
    async def main() -> None:
        writer = RunWriter(folder)
        for value in (math.nan, math.inf):
            for put in (
                lambda given: writer.readings("air", "°C", given), lambda given: writer.samples("air", "s", given),
            ):  # fmt: skip
                with pytest.raises(StoreError) as found:
                    put(air(1.0, value))
                assert str(found.value) == "air: a reading was not a number and is not stored; check the instrument"
        await writer.commit()
        writer.close()

    played(main)


def test_what_nobody_commits_is_durable_soon_and_not_at_once(folder, monkeypatch):
    monkeypatch.setattr(module, "GROUP_S", 0.2)

    async def main() -> None:
        writer = RunWriter(folder)
        writer.frames("counter", "s", FRAMES)
        await asyncio.sleep(0.05)
        assert writer.commits[0] == 0
        for _ in range(100):
            await asyncio.sleep(0.02)
            if writer.commits[0]:
                break
        with RunReader(folder) as reader:
            assert [len(block) for _, _, block in reader.blocks()] == [3]
        writer.close()

    played(main)


def test_commits_are_counted_and_what_waits_is_known(folder):
    async def main() -> None:
        writer = RunWriter(folder)
        assert writer.commits == (0, False)
        writer.event("a")
        await writer.commit()
        assert writer.commits == (1, False)
        await writer.commit()
        assert writer.commits[0] == 2
        writer.close()

    played(main)


def test_the_ledger_has_a_head_from_time_to_time(folder, monkeypatch):
    async def main() -> None:
        writer = RunWriter(folder)
        for kind in ("a", "b"):
            writer.event(kind)
            await writer.commit()
        (entry,) = ledger.entries_of("a run")
        assert (entry.beginning, entry.number, entry.rows) == (writer.beginning.hex(), 1, 1)
        monkeypatch.setattr(module, "LEDGER_EVERY_S", 0.0)
        with (state_folder() / ledger.LEDGER).open("ab") as file:
            file.write(b'{"run": "a run", \xff}\n["a run"]\n' + b"[" * 100_000 + b"a run\n")
        writer.event("c")
        await writer.commit()
        assert [each.number for each in ledger.entries_of("a run")] == [1, 3]
        assert writer.ledger_problem == ""
        (state_folder() / ledger.LEDGER).unlink()
        (state_folder() / ledger.LEDGER).mkdir()
        writer.event("d")
        await writer.commit()
        assert writer.ledger_problem.startswith("the ledger of this computer cannot be written (")
        assert writer.ledger_problem.endswith("; the run goes on")
        writer.close()

    played(main)


def test_without_a_ledger_it_has_none(folder):
    async def main() -> None:
        writer = RunWriter(folder, noted=False)
        writer.event("a")
        await writer.commit()
        writer.close()

    played(main)
    assert list(ledger.entries_of("a run")) == []
    (folder / "run.db").write_bytes(b"no database" * 500)
    told = "the ledger has no entry for this run: it may have been killed before its first commit"
    assert told in examine(folder).damage


def failed(folder: Path, act: Any) -> tuple[str, Path]:
    """What a writer says after something has happened to its folder, and where its record is then."""
    found: list[Any] = []

    async def main() -> None:
        writer = RunWriter(folder)
        heard: list[StoreError] = []
        writer.on_failure = heard.append
        writer.event("kept")
        await writer.commit()
        act()
        writer.event("seen")
        with pytest.raises(StoreError) as told:
            await writer.commit()
        assert list(map(str, heard)) == [str(told.value)]
        found.extend((str(told.value), writer.folder))
        with pytest.raises(StoreError):
            writer.close()

    played(main)
    return found[0], found[1]


def kinds(folder: Path) -> list[str]:
    with RunReader(folder) as reader:
        return [event.kind for event in reader.events()]


def test_a_folder_that_is_moved_has_the_record(folder, tmp_path):
    moved = tmp_path / "moved"
    told, where = failed(folder, lambda: folder.rename(moved))
    assert told == f"the run directory {folder} was moved to {moved} during the run; its record is there"
    assert where == moved
    assert kinds(moved) == ["kept", "seen"]


def test_of_one_that_is_removed_a_copy_is_kept(folder):
    told, where = failed(folder, lambda: shutil.rmtree(folder))
    assert where == state_folder() / "rescued" / "a run"
    assert (
        told == f"the run directory {folder} was removed during the run; everything recorded until then is in {where}"
    )
    assert kinds(where) == ["kept", "seen"]


def test_of_a_database_that_is_removed_too(folder):
    told, where = failed(folder, (folder / database.FILE_NAME).unlink)
    assert told.startswith(f"{folder / database.FILE_NAME} was removed during the run; everything recorded")
    assert kinds(where) == ["kept", "seen"]


def test_where_no_copy_can_be_kept_that_is_said(folder):
    (state_folder() / "rescued").write_text("in the way")
    told, where = failed(folder, lambda: shutil.rmtree(folder))
    assert told.startswith(f"the run directory {folder} was removed during the run; nothing of it could be kept (")
    assert where == folder


def test_of_a_database_that_is_truncated_what_can_be_read_is_kept(folder):
    path = folder / database.FILE_NAME
    told, where = failed(folder, lambda: os.truncate(path, 0))
    assert told == f"{path} was truncated during the run; everything recorded until then is in {where}"
    assert where == state_folder() / "rescued" / "a run"
    assert kinds(where) == ["kept"]


def test_where_that_cannot_be_kept_it_is_said(folder):
    (state_folder() / "rescued").write_text("in the way")
    path = folder / database.FILE_NAME
    told, where = failed(folder, lambda: os.truncate(path, 0))
    assert told.startswith(f"{path} was truncated during the run; nothing of it could be kept (")
    assert where == folder


def test_what_is_written_of_an_event_is_the_same_for_equal_events(folder):
    async def main() -> None:
        writer = RunWriter(folder)
        writer.event("a", b=1, a="°")
        with pytest.raises(ValueError, match="not JSON compliant"):
            writer.event("a", b=math.nan)
        await writer.commit()
        writer.close()

    played(main)
    with closing(sqlite3.connect(folder / database.FILE_NAME)) as opened:
        assert opened.execute("SELECT data FROM journal").fetchone() == ('{"a": "°", "b": 1}',)


def test_the_link_of_an_entry_is_the_same_when_its_time_was_a_number_of_numpy(folder):
    async def main() -> None:
        writer = RunWriter(folder)
        await asyncio.sleep(np.float64(1.5))
        assert isinstance(asyncio.get_running_loop().time(), np.float64)
        writer.event("late")
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert examine(folder).damage == ()


def test_samples_of_which_there_are_none_make_no_commit(folder):
    async def main() -> None:
        writer = RunWriter(folder)
        writer.samples("dvm", "step", [])
        await writer.commit()
        writer.close()
        assert writer.link.number == 0

    played(main)


LINK = (1, *NOTHING.values(), b"\0" * HEAD_BYTES)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        (("1", *LINK[1:]), "an entry of the hash chain is malformed"),
        ((1, "0", *LINK[2:]), "an entry of the hash chain is malformed"),
        ((*LINK[:-1], "0" * HEAD_BYTES), "an entry of the hash chain is malformed"),
        ((*LINK[:-1], b"\0" * 31), "an entry of the hash chain has no hash"),
    ],
)
def test_a_link_that_is_malformed_is_told(row, told):
    assert Link.from_row(LINK).to_row() == LINK
    with pytest.raises(ValueError, match=rf"^{told}$"):
        Link.from_row(row)


def test_two_commits_that_the_ledger_does_not_know_are_told_by_the_first(folder, monkeypatch):
    monkeypatch.setattr(module, "LEDGER_EVERY_S", 0.0)

    async def main() -> None:
        writer = RunWriter(folder)
        for kind in ("a", "b", "c"):
            writer.event(kind)
            await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    path = state_folder() / ledger.LEDGER
    first, *others = path.read_text("utf-8").splitlines()
    heads = [entry.head for entry in ledger.entries_of("a run")]
    changed = [line.replace(head, "0" * 64) for line, head in zip(others, heads[1:], strict=True)]
    path.write_text("\n".join([first, *changed]) + "\n", "utf-8")
    (told,) = (each for each in examine(folder).damage if "ledger" in each)
    assert told.startswith("commit 2 is not the one in the ledger, of 2")
