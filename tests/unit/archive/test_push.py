"""Publication of a run: whole or not at all, once, and with the numbers of its results."""

from __future__ import annotations

import json
import math
import shutil
from collections import defaultdict
from pathlib import Path

import pytest

from bench.archive.destination import Destination
from bench.archive.publish import push
from bench.archive.query import Archive, opened
from bench.archive.rows import as_table
from bench.archive.tables import Tables
from bench.errors import InputError, StoreError
from bench.reduce.stored_run import open_run
from bench.report.approval import APPROVAL, SCHEMA
from tests.support.archives import findings, with_runs


@pytest.fixture(scope="module")
def run(shared_runs, tmp_path_factory) -> Path:
    made = shared_runs.tumble()
    return Path(shutil.copytree(made.path, tmp_path_factory.mktemp("pushed") / made.path.name))


@pytest.fixture(scope="module")
def archive(run, tmp_path_factory) -> Archive:
    folder = tmp_path_factory.mktemp("archive")
    push(run, Destination(str(folder)))
    return opened(str(folder))


def _counts(folder: Path) -> dict[str, int]:
    found = opened(str(folder))
    return {
        name: found.query(f"SELECT count(*) FROM {name}").rows[0][0]
        for name in ("runs", "findings", "budgets", "instruments", "certificates")
    }


def test_all_numbers_of_the_results_are_there(run, archive) -> None:
    content = json.loads((run / "results.json").read_text())
    rows = archive.query("SELECT id, value, u, expanded, low, high, verdict, unit FROM findings").rows
    expected = [
        (
            each["id"], each["value"], each["u"], each["expanded"], (each["limits"] or {}).get("min"),
            (each["limits"] or {}).get("max"), each["verdict"], each["unit"],
        )
        for each in content["findings"]
    ]  # fmt: skip
    assert len(expected) > 20
    assert sorted(rows, key=str) == sorted(expected, key=str)


def test_the_lines_of_a_budget_add_up_to_the_uncertainty(archive) -> None:
    squares: dict[str, float] = defaultdict(float)
    for id_, u in archive.query("SELECT id, u FROM budgets").rows:
        squares[id_] += u**2
    found = dict(archive.query("SELECT id, u FROM findings WHERE quantity = 'K0'").rows)
    assert len(found) > 1
    for id_, u in found.items():
        assert math.sqrt(squares[id_]) == pytest.approx(u, rel=1e-6), id_


def test_the_row_of_the_run_and_its_instruments_are_those_of_the_manifest(run, archive) -> None:
    manifest = json.loads((run / "manifest.json").read_text())
    (found,) = archive.query("SELECT * FROM runs").records()
    assert found["uuid"] == manifest["uuid"]
    assert found["started"].isoformat() == manifest["started"]
    assert (found["verdict"], found["units"], found["simulated"]) == ("PASS", "QF-0001", True)
    assert json.loads(found["manifest"]) == manifest
    serials = dict(archive.query("SELECT role, serial FROM instruments").rows)
    assert serials == {role: each["serial"] for role, each in manifest["instruments"].items()}


def test_data_beside_the_files_are_those_of_the_run(run, archive) -> None:
    files = json.loads(archive.query("SELECT files FROM runs").rows[0][0])
    assert {"run.db", "seal.json", "report.html", "raw/readings.parquet", "raw/journal.parquet"} <= files.keys()
    place = Path(archive.destination.url.removeprefix("file://")) / files["raw/journal.parquet"]["object"]
    kept = archive.query(f"SELECT seq, kind FROM read_parquet('{place}') ORDER BY seq").rows
    with open_run(run) as stored:
        assert kept == [(event.seq, event.kind) for event in stored.reader.events()]


def test_a_run_that_is_there_is_left_as_it_is(run, tmp_path) -> None:
    destination = Destination(str(tmp_path / "archive"))
    first, second = push(run, destination), push(run, destination)
    assert (first.was_there, second.was_there, second.number) == (False, True, 1)
    assert _counts(tmp_path / "archive")["runs"] == 1


class _Killed(BaseException):
    """The process ends here."""


def test_a_push_that_is_cut_anywhere_shows_nothing_and_is_completed_by_the_next(smoke_copy, tmp_path) -> None:
    names: list[str] = []
    push(smoke_copy, Destination(str(tmp_path / "whole")), watch=names.append)
    whole = sorted(Destination(str(tmp_path / "whole")).names(""))
    assert len(names) > 10
    for number in (0, 3, 8, *range(len(names) - 6, len(names) - 1)):
        folder = tmp_path / f"cut-{number}"
        seen: list[str] = []

        def cut(name: str, seen: list[str] = seen, number: int = number) -> None:
            seen.append(name)
            if len(seen) > number:
                raise _Killed

        with pytest.raises(_Killed):
            push(smoke_copy, Destination(str(folder)), watch=cut)
        assert set(_counts(folder).values()) == {0}, f"visible after {seen[-1]}"
        push(smoke_copy, Destination(str(folder)))
        assert _counts(folder) == _counts(tmp_path / "whole")
        assert sorted(Destination(str(folder)).names("")) == whole


def test_an_approved_report_is_a_new_version_and_the_first_stays(smoke_copy, tmp_path) -> None:
    folder = tmp_path / "archive"
    push(smoke_copy, Destination(str(folder)))
    content = {
        "schema": SCHEMA, "report": "LAB-2026-00001", "run": smoke_copy.name, "by": "boris",
        "at": "2026-02-01T10:00:00+00:00", "head": "0" * 64, "calibrations": {}, "laboratory": {"name": "Lab"},
        "fields": {"customer": "Customer"},
    }  # fmt: skip
    (smoke_copy / APPROVAL).write_text(json.dumps(content))
    assert push(smoke_copy, Destination(str(folder))).number == 2
    found = opened(str(folder))
    assert found.query("SELECT version, report FROM all_runs ORDER BY version").rows == [
        (1, None),
        (2, "LAB-2026-00001"),
    ]
    assert found.query("SELECT version FROM runs").rows == [(2,)]
    assert found.query("SELECT report, customer FROM certificates").rows == [("LAB-2026-00001", "Customer")]
    once, twice = (found.query(f"SELECT count(*) FROM {name}").rows[0][0] for name in ("findings", "all_findings"))
    assert twice == 2 * once > 0


def test_a_run_without_its_seal_or_with_damage_is_refused(smoke_copy, tmp_path) -> None:
    destination = Destination(str(tmp_path / "archive"))
    with (smoke_copy / "results.json").open("a") as file:
        file.write(" ")
    with pytest.raises(InputError, match="damaged"):
        push(smoke_copy, destination)
    (smoke_copy / "seal.json").unlink()
    with pytest.raises(InputError, match=r"damaged|seal"):
        push(smoke_copy, destination)
    assert not list(destination.names(""))


def test_a_push_that_reads_back_something_else_is_an_error(smoke_copy, tmp_path, monkeypatch) -> None:
    """A disk that alters what it stores, such as one with a broken cable."""
    destination = Destination(str(tmp_path / "archive"))
    written = Destination.write

    def altered(self: Destination, name: str, data: bytes | Path) -> None:
        written(self, name, Path(data).read_bytes()[:-1] + b"?" if name.endswith("run.db") else data)

    monkeypatch.setattr(Destination, "write", altered)
    with pytest.raises(StoreError, match=r"run\.db: reads back as sha256:"):
        push(smoke_copy, destination)
    assert _counts(tmp_path / "archive")["runs"] == 0


def test_the_same_rows_twice_are_there_once(tmp_path) -> None:
    """Two computers that push copies of one run at the same moment."""
    destination = Destination(str(tmp_path))
    destination.begin()
    rows = findings("QF-1", [1e-3])
    for _ in range(2):
        Tables(destination).append("findings", as_table("findings", rows), "one-v0001")
        Tables(destination).append("runs", as_table("runs", with_runs(rows)), "one-v0001")
    assert opened(str(tmp_path)).query("SELECT count(*) FROM findings").rows == [(1,)]
