"""Places of an archive: what they refuse, what their errors say, and files that are restored from them."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing

import pytest

from bench.archive.database import SqlDatabase
from bench.archive.destination import ABOUT, Destination, in_words
from bench.archive.fetch import fetch
from bench.archive.libraries import obstore
from bench.archive.pending import pending_runs
from bench.archive.publish import push
from bench.archive.query import opened
from bench.archive.tables import Tables
from bench.errors import InputError, StoreError
from bench.store.verify import examine
from tests.support.archives import fill, findings, with_runs


def test_of_two_that_create_an_object_one_is_refused(tmp_path) -> None:
    destination = Destination(str(tmp_path))
    assert destination.create("a", b"first")
    assert not destination.create("a", b"second")
    assert destination.read("a") == b"first"
    destination.prove()
    assert list(destination.names("")) == ["a"]


def test_a_store_that_overwrites_is_refused(tmp_path, monkeypatch) -> None:
    destination = Destination(str(tmp_path))

    def overwriting(name: str, data: bytes) -> bool:
        destination.write(name, data)
        return True

    monkeypatch.setattr(destination, "create", overwriting)
    with pytest.raises(StoreError, match="overwrites an object that must not exist"):
        destination.prove()
    assert not list(destination.names(""))


def test_a_folder_without_an_archive_is_named(tmp_path) -> None:
    with pytest.raises(InputError, match="there is no archive; 'bench archive push RUN file://"):
        opened(str(tmp_path / "nowhere"))


def test_an_archive_of_another_version_is_refused(tmp_path) -> None:
    (tmp_path / ABOUT).write_text(json.dumps({"schema": "itb-archive/9"}))
    with pytest.raises(InputError, match="itb-archive/9; this version reads and writes itb-archive/1"):
        opened(str(tmp_path))
    (tmp_path / ABOUT).write_text("garbage")
    with pytest.raises(InputError, match="unreadable"):
        Destination(str(tmp_path)).begin()


@pytest.mark.parametrize("url", ["ftp://host/x", "gs://bucket/x", "http://host/x", "sqlite:///x"])
def test_other_kinds_of_places_are_refused(url) -> None:
    with pytest.raises(InputError, match="an archive is a folder, s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX"):
        Destination(url)


def test_a_bucket_without_tls_is_for_this_computer_only(monkeypatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT", "http://192.0.2.7:9000")
    with pytest.raises(InputError, match=r"http://192\.0\.2\.7:9000: is without TLS.*AWS_ALLOW_HTTP=true"):
        Destination("s3://lab/a")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    assert Destination("s3://lab/a").options["allow_http"] == "true"
    monkeypatch.delenv("AWS_ALLOW_HTTP")
    monkeypatch.setenv("AWS_ENDPOINT", "http://127.0.0.1:9000")
    assert Destination("s3://lab/a").options["allow_http"] == "true"


def test_a_disk_that_cannot_be_written_is_named(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="file"):
        Destination(str(tmp_path / "file" / "archive"))


@pytest.mark.parametrize(
    ("answer", "advice"),
    [
        ("No space left on device (os error 28)", "it is full"),
        ("Server returned non-2xx status code: 507 Insufficient Storage", "it is full"),
        ("RequestTimeTooSkewed: The difference between the request time", "the clocks of this computer"),
        ("<Code>NoSuchBucket</Code>", "there is no such bucket"),
        ("error sending request: tcp connect error: Connection refused", "the store does not answer"),
    ],
)
def test_errors_of_stores_say_what_to_do(answer, advice) -> None:
    assert advice in in_words("s3://lab/a", OSError(answer))
    assert answer in in_words("s3://lab/a", OSError(answer))


@pytest.mark.parametrize(
    "answer",
    [
        "probe/9ec507a1: 403 Forbidden",
        "PUT http://127.0.0.1:9000/quota-2026/a: 403 Forbidden",
        "<Error><Code>AccessDenied</Code><Message>Access Denied.</Message><BucketName>read-only</BucketName></Error>",
        "<Error><Code>AccessDenied</Code><Message>Access Denied.</Message><Resource>/quota</Resource></Error>",
    ],
)
def test_names_of_buckets_and_objects_are_no_reasons(answer) -> None:
    refused = obstore().exceptions.PermissionDeniedError(answer)
    assert "the store refuses the key" in in_words("s3://lab/a", refused)


def test_a_restored_run_is_the_one_that_was_pushed(smoke_copy, tmp_path) -> None:
    push(smoke_copy, Destination(str(tmp_path / "archive")))
    got = fetch(opened(str(tmp_path / "archive")), smoke_copy.name, tmp_path / "got")
    assert examine(got).kind == "sealed"
    assert (got / "run.db").read_bytes() == (smoke_copy / "run.db").read_bytes()
    with pytest.raises(InputError, match="exists already"):
        fetch(opened(str(tmp_path / "archive")), smoke_copy.name, tmp_path / "got")
    with pytest.raises(InputError, match="has no version 7"):
        fetch(opened(str(tmp_path / "archive")), smoke_copy.name, tmp_path / "other", version=7)


def test_an_altered_object_is_noticed_and_nothing_is_restored(smoke_copy, tmp_path) -> None:
    push(smoke_copy, Destination(str(tmp_path / "archive")))
    (results,) = (tmp_path / "archive").rglob("results.json")
    results.write_text(results.read_text().replace("PASS", "FAIL"))
    with pytest.raises(StoreError, match=r"results\.json: has changed since it was archived"):
        fetch(opened(str(tmp_path / "archive")), smoke_copy.name, tmp_path / "got")
    assert not list((tmp_path / "got").glob("*"))


def test_a_name_that_leaves_the_folder_is_refused(tmp_path) -> None:
    rows = findings("QF-1", [1e-3])
    entry = {"../../evil": {"object": ABOUT, "sha256": "", "bytes": 1}}
    fill(tmp_path, findings=rows, runs=[row | {"files": json.dumps(entry)} for row in with_runs(rows)])
    with pytest.raises(StoreError, match="is no name of a file of a run"):
        fetch(opened(str(tmp_path)), "QF-1-0000", tmp_path / "got")
    assert not (tmp_path.parent / "evil").exists()


def test_only_runs_that_are_missing_are_pending(smoke_copy, tmp_path) -> None:
    destination = Destination(str(tmp_path / "archive"))
    assert pending_runs(smoke_copy.parent, destination) == [smoke_copy]
    assert pending_runs(smoke_copy.parent, destination, approved=True) == []
    push(smoke_copy, destination)
    assert pending_runs(smoke_copy.parent, destination) == []


def test_tidied_tables_have_the_same_rows_in_fewer_files(tmp_path) -> None:
    for number in range(4):
        rows = findings(f"QF-{number}", [1e-3, 2e-3])
        destination = fill(tmp_path, file=f"of-{number}", findings=rows, runs=with_runs(rows))
    before = opened(str(tmp_path)).query("SELECT * FROM findings ORDER BY uut, id, started").rows
    assert len(before) == 8
    assert Tables(destination).tidy()["findings"] == (4, 1)
    assert opened(str(tmp_path)).query("SELECT * FROM findings ORDER BY uut, id, started").rows == before


def test_runs_and_findings_go_to_a_database_once(tmp_path) -> None:
    rows = findings("QF-1", [1e-3, 2e-3])
    fill(tmp_path / "archive", findings=rows, runs=with_runs(rows))
    with closing(SqlDatabase(f"sqlite:///{tmp_path}/lims.db")) as database:
        assert database.upsert(opened(str(tmp_path / "archive"))) == 2
        assert database.upsert(opened(str(tmp_path / "archive"))) == 0
    with closing(sqlite3.connect(tmp_path / "lims.db")) as connection:
        assert connection.execute("SELECT uut, value FROM itb_findings ORDER BY value").fetchall() == [
            ("QF-1", 1e-3), ("QF-1", 2e-3)
        ]  # fmt: skip


def test_a_new_version_replaces_the_rows_of_its_run_in_the_database(tmp_path) -> None:
    first, second = findings("QF-1", [1e-3]), findings("QF-1", [2e-3], version=2)
    fill(tmp_path / "archive", findings=first, runs=with_runs(first))
    with closing(SqlDatabase(f"sqlite:///{tmp_path}/lims.db")) as database:
        database.upsert(opened(str(tmp_path / "archive")))
        fill(tmp_path / "archive", file="second", findings=second, runs=with_runs(second))
        assert database.upsert(opened(str(tmp_path / "archive"))) == 1
    with closing(sqlite3.connect(tmp_path / "lims.db")) as connection:
        assert connection.execute("SELECT value FROM itb_findings").fetchall() == [(2e-3,)]
        assert connection.execute("SELECT version FROM itb_runs").fetchall() == [(2,)]


def test_a_database_that_cannot_be_used_is_named_without_its_password() -> None:
    with pytest.raises(InputError, match="the URL of the database is wrong"):
        SqlDatabase("nonsense")
    with pytest.raises(InputError, match="the URL of the database is wrong"):
        SqlDatabase("oraacle://me:secret@host/x")
    with pytest.raises(StoreError, match=r"sqlite:///.*unable to open database file; the export can be repeated"):
        SqlDatabase("sqlite:////nowhere/at/all.db")
