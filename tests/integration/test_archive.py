"""Archives in the servers of other people: two that keep conditional writes, one that does not, and a database."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from bench.archive.database import SqlDatabase
from bench.archive.query import opened
from tests.support.archives import fill, findings, start_runtimes, with_runs
from tests.support.buckets import BUCKETS, ROOT, Bucket, azurite, moto, s3rver
from tests.support.postgres import postgres

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("moto", "azurite", "s3rver")]


@pytest.fixture(scope="module", autouse=True)
def _runtimes_of_libraries(tmp_path_factory) -> None:
    start_runtimes(tmp_path_factory.mktemp("first"))


@pytest.fixture(scope="module", params=list(BUCKETS))
def bucket(request, tmp_path_factory):
    with BUCKETS[request.param](tmp_path_factory.mktemp(request.param)) as found:
        yield found


@pytest.fixture(scope="module")
def runs(tmp_path_factory, shared_runs) -> Path:
    """Four runs of the smoke sequence."""
    folder = tmp_path_factory.mktemp("several") / "runs"
    for seed in range(4):
        _bench("run", "smoke", "--seed", seed, "--runs", folder, "--no-report").check_returncode()
    return folder


def _words(*words: object) -> list[str]:
    return [sys.executable, "-m", "bench", *map(str, words)]


def _bench(
    *words: object, bucket: Bucket | None = None, clock: str = "", **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run a command, on a clock that is off by `clock`, such as "+1h"."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), **(bucket.variables if bucket else {}), **variables}
    shifted = ["faketime", "-f", clock] if clock else []
    return subprocess.run(
        [*shifted, *_words(*words)], env=env, cwd=ROOT, text=True, capture_output=True, timeout=120, check=False
    )


def _rows(bucket: Bucket, sql: str, **variables: str) -> str:
    found = _bench("archive", "query", sql, "--archive", bucket.url, "--json", bucket=bucket, **variables)
    assert found.returncode == 0, found.stderr
    return found.stdout.strip()


def test_a_run_goes_to_a_bucket_once_and_comes_back(bucket, smoke_copy, tmp_path) -> None:
    for said in ("version 1 published to", "is there already"):
        pushed = _bench("archive", "push", smoke_copy, bucket.url, bucket=bucket)
        assert pushed.returncode == 0, pushed.stderr
        assert said in pushed.stdout
    name = smoke_copy.name
    assert _rows(bucket, f"SELECT verdict FROM runs WHERE run = '{name}'") == '[{"verdict": "PASS"}]'
    got = _bench("archive", "fetch", name, "--archive", bucket.url, "--into", tmp_path / "got", bucket=bucket)
    assert got.returncode == 0, got.stderr
    assert (tmp_path / "got" / name / "run.db").read_bytes() == (smoke_copy / "run.db").read_bytes()


def test_writers_at_once_lose_nothing_and_leave_nothing_twice(bucket, runs, tmp_path) -> None:
    """Two computers with a copy of all runs each, which they push in opposite orders."""
    copies = [Path(shutil.copytree(runs, tmp_path / f"computer-{number}" / "runs")) for number in range(2)]
    env = {**os.environ, "PYTHONPATH": str(ROOT), **bucket.variables}
    writers = []
    for number, folder in enumerate(copies):
        order = sorted(folder.iterdir(), reverse=bool(number))
        words = _words("archive", "push", *order, bucket.url)
        writers.append(subprocess.Popen(words, env=env, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT))
    said = [writer.communicate(timeout=120)[0].decode() for writer in writers]
    assert [writer.returncode for writer in writers] == [0, 0], said
    where = " OR ".join(f"run = '{each.name}'" for each in runs.iterdir())
    assert _rows(bucket, f"SELECT count(*) n, count(DISTINCT uuid) d FROM all_runs WHERE {where}") == (
        '[{"n": 4, "d": 4}]'
    )
    twice = f"SELECT run, id FROM all_findings WHERE {where} GROUP BY ALL HAVING count(*) <> 1"
    assert _rows(bucket, twice) == "[]"


def test_a_push_that_is_killed_is_completed(bucket, runs) -> None:
    run = sorted(runs.iterdir())[0]
    env = {**os.environ, "PYTHONPATH": str(ROOT), **bucket.variables}
    dest = f"{bucket.url}-killed"
    for after_s in (0.6, 1.0, 1.4):
        process = subprocess.Popen(_words("archive", "push", run, dest), env=env, cwd=ROOT, stderr=subprocess.DEVNULL)
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
    assert _bench("archive", "push", run, dest, bucket=bucket).returncode == 0
    there = Bucket(dest, bucket.variables)
    assert _rows(there, "SELECT count(*) n FROM all_runs") == '[{"n": 1}]'
    assert _rows(there, "SELECT id FROM findings GROUP BY id HAVING count(*) <> 1") == "[]"


def test_a_store_that_overwrites_is_refused(tmp_path, smoke_copy) -> None:
    with s3rver(tmp_path / "store") as bucket:
        pushed = _bench("archive", "push", smoke_copy, bucket.url, bucket=bucket)
    assert pushed.returncode == 3
    assert "the store overwrites an object that must not exist" in pushed.stderr
    assert "two benches would lose each other's results" in pushed.stderr


def test_a_wrong_key_and_a_container_that_is_not_there_are_named(tmp_path, smoke_copy) -> None:
    with azurite(tmp_path / "store") as bucket:
        wrong = {"AZURE_STORAGE_ACCOUNT_KEY": "d3Jvbmcga2V5IQ=="}
        pushed = _bench("archive", "push", smoke_copy, bucket.url, bucket=bucket, **wrong)
        assert pushed.returncode == 3
        assert "the store refuses the key: check the key and its rights" in pushed.stderr
        missing = _bench("archive", "push", smoke_copy, "azure://nowhere/a", bucket=bucket)
        assert missing.returncode == 3
        assert "there is no such container" in missing.stderr


def test_a_server_that_is_away_is_named_within_a_minute_or_so(tmp_path, smoke_copy) -> None:
    with moto(tmp_path / "store") as bucket:
        pass
    pushed = _bench("archive", "push", smoke_copy, bucket.url, bucket=bucket)
    assert pushed.returncode == 3
    assert "the store does not answer: check the network and the address" in pushed.stderr


@pytest.mark.peer("faketime")
@pytest.mark.parametrize("clock", ["+1h", "-1h"])
def test_a_clock_that_is_off_is_named_by_a_store_that_compares_it(tmp_path, smoke_copy, clock) -> None:
    with s3rver(tmp_path / "store") as bucket:
        pushed = _bench("archive", "push", smoke_copy, bucket.url, bucket=bucket, clock=clock)
    assert pushed.returncode == 3
    assert "the clocks of this computer and of the store differ: set the clock here" in pushed.stderr


@pytest.mark.peer("faketime")
def test_benches_whose_clocks_differ_by_hours_lose_nothing_and_leave_nothing_twice(bucket, runs) -> None:
    dest = f"{bucket.url}-clocks"
    for clock, run in zip(("+1h", "", "-1h", "+1h"), sorted(runs.iterdir()), strict=True):
        assert _bench("archive", "push", run, dest, bucket=bucket, clock=clock).returncode == 0
        assert _bench("archive", "push", run, dest, bucket=bucket).returncode == 0
    there = Bucket(dest, bucket.variables)
    assert _rows(there, "SELECT count(*) n, count(DISTINCT uuid) runs FROM all_runs") == '[{"n": 4, "runs": 4}]'
    assert _rows(there, "SELECT uuid, id FROM all_findings GROUP BY ALL HAVING count(*) <> 1") == "[]"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a small disk")
def test_a_full_store_is_named_and_the_push_is_completed_on_a_larger_one(tmp_path, smoke_copy) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    size = "size=40k"
    if subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", disk], check=False).returncode:
        pytest.skip("this computer mounts no disk for us")
    try:
        pushed = _bench("archive", "push", smoke_copy, disk / "archive")
        assert pushed.returncode == 3
        assert "it is full: free space there; the push can be repeated" in pushed.stderr
        subprocess.run(["mount", "-o", "remount,size=10m", disk], check=True)
        assert _bench("archive", "push", smoke_copy, disk / "archive").returncode == 0
        assert opened(str(disk / "archive")).query("SELECT count(*) FROM all_runs").rows == [(1,)]
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


@pytest.mark.peer("postgres")
def test_findings_go_to_postgresql_and_an_export_that_was_cut_goes_on(tmp_path) -> None:
    import psycopg

    rows = [row for number in range(40) for row in findings(f"QF-{number}", [1e-3, 2e-3])]
    fill(tmp_path / "archive", findings=rows, runs=with_runs(rows))
    with postgres(tmp_path / "postgres") as url:
        archive = opened(str(tmp_path / "archive"))

        def cut(run: str, seen: list[str] = []) -> None:  # noqa: B006  it counts
            seen.append(run)
            if len(seen) == 30:
                raise KeyboardInterrupt

        with closing(SqlDatabase(url)) as database, pytest.raises(KeyboardInterrupt):
            database.upsert(archive, cut)
        exported = _bench("archive", "export", "--archive", tmp_path / "archive", BENCH_SQL_URL=url)
        assert exported.returncode == 0, exported.stderr
        assert "50 runs written" in exported.stdout
        with closing(psycopg.connect(url.replace("+psycopg", ""))) as connection:
            found = connection.execute("SELECT uut, value, started FROM itb_findings JOIN itb_runs USING (uuid)")
            assert sorted(found.fetchall()) == sorted((row["uut"], row["value"], row["started"]) for row in rows)
