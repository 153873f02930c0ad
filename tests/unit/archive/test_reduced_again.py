"""Re-reductions in an archive: new versions, beside the earlier ones."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from bench.archive.columns import TABLES
from bench.archive.destination import Destination
from bench.archive.fetch import fetch
from bench.archive.publish import push
from bench.archive.query import Archive, opened
from bench.archive.reduction import candidates, reduce_again
from bench.archive.tables import Tables
from bench.errors import StoreError
from tests.support.archives import fill, findings, with_runs
from tests.support.runs import sealed_anew

NOW = "2.0 0123456789abcdef"


@pytest.fixture
def archive(smoke_copy, tmp_path) -> Archive:
    """An archive with a run of an earlier program, whose first value was 5 u higher."""
    results = json.loads((smoke_copy / "results.json").read_text("utf-8"))
    first = results["findings"][0]
    first["value"] += 5 * first["u"]
    first["verdict"] = "FAIL"
    (smoke_copy / "results.json").write_text(json.dumps(results), "utf-8")
    folder = tmp_path / "archive"
    push(sealed_anew(smoke_copy), Destination(str(folder)))
    return opened(str(folder))


def _again(archive: Archive, scratch: Path, **more: Any):
    found = opened(archive.destination.url)
    (each,) = candidates(found, NOW)
    scratch.mkdir()
    result = reduce_again(found, each.uuid, each.version, scratch, program=NOW, **more)
    return result, opened(archive.destination.url)


def test_a_changed_result_is_a_new_version_and_the_earlier_one_can_be_read(archive, smoke_copy, tmp_path) -> None:
    first = archive.query("SELECT id, value, u FROM findings WHERE verdict = 'FAIL'").rows
    ((name, value, u),) = first
    found, later = _again(archive, tmp_path / "a", publish=True)
    assert [change.id for change in found.found.changes] == [name]
    assert found.published == 2
    assert later.query("SELECT version, reduced_by FROM all_runs ORDER BY version").rows == [(1, None), (2, NOW)]
    ((changed,),) = later.query("SELECT value FROM findings WHERE id = ?", [name]).rows
    assert changed == pytest.approx(value - 5 * u)
    assert later.query("SELECT value FROM all_findings WHERE id = ? AND version = 1", [name]).rows == [(value,)]
    restored = fetch(later, smoke_copy.name, tmp_path / "restored")
    assert (restored / "results.json").read_bytes() == (smoke_copy / "results.json").read_bytes()


def test_without_publish_or_without_a_change_there_is_no_new_version(archive, tmp_path) -> None:
    found, later = _again(archive, tmp_path / "a")
    assert found.found.changes
    assert found.published is None
    assert len(later.query("SELECT * FROM all_runs").rows) == 1
    again, _ = _again(archive, tmp_path / "b", publish=True)
    uuid = later.query("SELECT uuid FROM runs").rows[0][0]
    (tmp_path / "c").mkdir()
    later = opened(archive.destination.url)
    unchanged = reduce_again(later, uuid, again.published, tmp_path / "c", program="3.0", publish=True)
    assert (unchanged.found.changes, unchanged.published) == ((), None)


def test_a_repeated_one_publishes_nothing_twice(archive, tmp_path) -> None:
    numbers = [_again(archive, tmp_path / name, publish=True)[0].published for name in "abc"]
    assert numbers == [2, 2, 2]
    later = opened(archive.destination.url)
    once, twice = (later.query(f"SELECT count(*) FROM {name}").rows[0][0] for name in ("findings", "all_findings"))
    assert twice == 2 * once


def test_one_that_is_cut_shows_nothing_and_is_completed_by_the_next(archive, smoke_copy, tmp_path, monkeypatch) -> None:
    def full(self: Tables, name: str, rows: Any, file: str) -> None:
        if name == "runs":
            raise StoreError("no space")
        keep(self, name, rows, file)

    keep = Tables.append
    monkeypatch.setattr(Tables, "append", full)
    with pytest.raises(StoreError, match="no space"):
        _again(archive, tmp_path / "a", publish=True)
    monkeypatch.undo()
    later = opened(archive.destination.url)
    assert later.query("SELECT max(version) FROM all_findings").rows == [(1,)]
    found, later = _again(archive, tmp_path / "b", publish=True)
    assert found.published == 2
    assert later.query("SELECT max(version) FROM all_findings").rows == [(2,)]


def test_a_push_after_it_leaves_it_the_latest_version(archive, smoke_copy, tmp_path) -> None:
    _again(archive, tmp_path / "a", publish=True)
    assert push(smoke_copy, Destination(archive.destination.url)).was_there
    assert opened(archive.destination.url).query("SELECT version FROM runs").rows == [(2,)]


def test_an_archive_of_an_earlier_program_is_read_and_gets_the_column(tmp_path, monkeypatch, smoke_copy) -> None:
    earlier = {name: kind for name, kind in TABLES["runs"].items() if name != "reduced_by"}
    with monkeypatch.context() as patched:
        for module in ("columns", "tables"):
            patched.setattr(f"bench.archive.{module}.TABLES", {**TABLES, "runs": earlier})
        rows = findings("QF-0009", [1e-3])
        fill(tmp_path / "archive", findings=rows, runs=with_runs(rows))
    kept = shutil.copytree(tmp_path / "archive", tmp_path / "kept")
    assert opened(str(kept)).query("SELECT uuid, reduced_by FROM runs").rows == [("QF-0009-0000", None)]
    push(smoke_copy, Destination(str(kept)))
    assert opened(str(kept)).query("SELECT count(*) FROM runs WHERE reduced_by IS NULL").rows == [(2,)]
