"""A station as a service: runs that are units of their own, a backup during a run, an upgrade during a run."""

from __future__ import annotations

import os
import shutil
import socket
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from tests.support.runs import ROOT
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow]
UNIT = ROOT / "config/services/bench-item@.service"
# What systemd would do for `systemctl start --no-block UNIT`: the commands are those of the file of the unit.
SYSTEMCTL = """\
#!{python}
import os, re, shlex, subprocess, sys
assert sys.argv[1:3] == ["start", "--no-block"], sys.argv
instance = re.fullmatch(r"bench-item@(.*)[.]service", sys.argv[3])[1]
text = open({unit!r}).read().replace("%I", instance.replace("-", "/")).replace("%i", instance)
text = text.replace("/var/lib/inertial-test-bench", {state!r})
if os.fork():
    sys.exit(0)
os.setsid()
nowhere = os.open(os.devnull, os.O_RDWR)
for number in (0, 1, 2):
    os.dup2(nowhere, number)
env = dict(os.environ, NOTIFY_SOCKET={socket!r})
env.update(line.split("=", 1) for line in re.findall("^Environment=(.*)$", text, re.M))
folder = re.search("^WorkingDirectory=(.*)$", text, re.M)[1]
with open({log!r}, "a") as log:
    for key in ("ExecStart", "ExecStopPost"):
        words = shlex.split(re.search(f"^{{key}}=(.*)$", text, re.M)[1])
        assert words[0] == "/opt/inertial-test-bench/bin/bench", words
        done = subprocess.run([sys.executable, "-m", "bench", *words[1:]], cwd=folder, env=env)
        log.write(f"{{key}} {{instance}} {{done.returncode}}\\n")
        log.flush()
"""


def test_with_launch_service_a_run_is_started_by_its_unit(tmp_path):
    programs, log = tmp_path / "programs", tmp_path / "log"
    programs.mkdir()
    systemctl = programs / "systemctl"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(30)
        systemctl.write_text(
            SYSTEMCTL.format(
                python=sys.executable,
                unit=str(UNIT),
                state=str(tmp_path),
                socket=str(tmp_path / "notify"),
                log=str(log),
            )
        )
        systemctl.chmod(stat.S_IRWXU)
        with serving(tmp_path, "--launch", "service", env={"PATH": f"{programs}:{os.environ['PATH']}"}) as station:
            item = station.submit()
            assert station.ended(item)["verdict"] == "PASS"
            station.until(lambda: log.read_text().count("\n") == 2)
        assert manager.recv(1000).startswith(b"READY=1\nSTATUS=")
    assert log.read_text() == f"ExecStart {item['id']}-1 0\nExecStopPost {item['id']}-1 0\n"


def test_where_no_unit_can_be_started_the_item_is_held_with_the_reason(tmp_path):
    systemctl = tmp_path / "systemctl"
    systemctl.write_text("#!/bin/sh\necho 'Access denied' >&2\nexit 4\n")
    systemctl.chmod(stat.S_IRWXU)
    (tmp_path / "station.yaml").write_text(
        "schema: itb-station/1\nbenches: {demo: {file: simulated}}\nlaunch: service\n"
    )
    with serving(tmp_path, "station.yaml", env={"PATH": f"{tmp_path}:{os.environ['PATH']}"}) as station:
        item = station.submit()
        held = station.until(lambda: (found := station.get(f"queue/{item['id']}"))["state"] == "held" and found)
        assert held["reason"] == f"bench-item@{item['id']}-1.service cannot be started: Access denied"


def test_a_station_tells_its_service_manager_that_it_is_ready_and_alive(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(30)
        env = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
        with serving(tmp_path, env=env) as station:
            received = {manager.recv(1000) for _ in range(8)}
            assert f"READY=1\nSTATUS=serves {station.url}".encode() in received
            assert b"WATCHDOG=1" in received


def bench(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench", *map(str, words)], cwd=folder, capture_output=True, text=True, check=False
    )


def test_a_backup_during_a_run_is_a_whole_station_elsewhere(tmp_path):
    first, again = tmp_path / "first", tmp_path / "again"
    first.mkdir()
    with serving(first) as station:
        answer = station.client.put("/api/v1/users/anna", json={"role": "engineer", "password": "correct horse 7"})
        assert answer.status_code == 204, answer.text
        ended = station.ended(station.submit())
        under_way, waiting = station.submit(speed="5"), station.submit(units={"a": "QF-0001"})
        run = paused(station, under_way)
        done = bench(first, "backup", first / "station", "--out", tmp_path / "kept.tar.gz", "--runs", first / "runs")
        assert done.returncode == 0, done.stderr
        assert f"{run}: left out, because it is under way" in done.stdout
        before, audited = station.get("queue", all_=True), station.get("audit")
        refused = bench(first, "restore", tmp_path / "kept.tar.gz", first / "station")
        assert (refused.returncode, "may be running" in refused.stderr) == (2, True)
        station.post(f"runs/{run}/resume")
        assert station.ended(under_way)["verdict"] == "PASS"  # nothing has disturbed it
    done = bench(tmp_path, "restore", "kept.tar.gz", again)
    assert done.returncode == 0, done.stderr
    database = Database(again / "station")
    assert Audit(database).first_wrong() is None
    database.close()
    with serving(again, has_users=True) as station:
        found = station.until(lambda: missing(station, under_way))
        assert found["reason"].startswith(f"{run}: the directory of this run is not in {again / 'runs'}")
        queue = [each["item"] for each in station.get("queue", all_=True)]
        assert sorted(each["id"] for each in queue) == sorted(each["item"]["id"] for each in before)
        assert len(queue) == 3
        assert ended in queue
        assert station.get(f"queue/{waiting['id']}")["state"] == "queued"  # until a person lets the bench go on
        assert station.get("audit")[: len(audited)] == audited
        assert [user["name"] for user in station.get("users")] == ["anna"]
        assert station.get("runs")[0]["run"] == ended["run"]
        assert bench(again, "runs", "verify", ended["run"]).returncode == 0
        login = station.client.post("/api/v1/login", json={"name": "anna", "password": "correct horse 7"})
        assert login.status_code == 200, login.text
        station.post("benches/demo/go-on")
        assert station.ended(waiting)["verdict"] == "PASS"


def paused(station, item):
    """Pause the run of an item as soon as it can be paused, and return its name."""
    run = station.until(lambda: station.get(f"queue/{item['id']}")["run"])
    station.until(lambda: station.client.post(f"/api/v1/runs/{run}/pause", json={}).status_code == 200)
    return run


def missing(station, item):
    found = station.get(f"queue/{item['id']}")
    return found if found["outcome"] == "missing" else None


def test_another_version_finds_the_run_of_the_one_before(tmp_path):
    other = tmp_path / "other"
    for name in ("bench", "drivers", "simulators", "sequences", "config", "docs/schema"):
        shutil.copytree(ROOT / name, other / name, ignore=shutil.ignore_patterns("__pycache__"))
    health = other / "bench/web/api/station.py"
    health.write_text(health.read_text().replace('status: str = "ok"', 'status: str = "ok, another version"'))
    env = {"PYTHONPATH": str(other), "PYTHONSAFEPATH": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with serving(tmp_path) as station:
        item, after = station.submit(speed="5"), station.submit()
        run = paused(station, item)
        pid = process_of(tmp_path / "runs" / run)
        assert station.client.get("/health").json() == {"status": "ok"}
    with serving(tmp_path, env=env) as station:
        assert station.client.get("/health").json() == {"status": "ok, another version"}
        assert station.get(f"queue/{item['id']}")["state"] == "running"
        assert process_of(tmp_path / "runs" / run) == pid
        station.post(f"runs/{run}/resume")
        ended = station.ended(item)
        assert (ended["verdict"], ended["run"]) == ("PASS", run)
        assert station.ended(after)["verdict"] == "PASS"  # of the other version


def process_of(run: Path) -> str:
    """The process that has the lock of a run, by the table of locks of the system."""
    inode = (run / "run.lock").stat().st_ino
    with suppress(StopIteration):
        return next(line.split()[4] for line in Path("/proc/locks").read_text().splitlines() if f":{inode} " in line)
    raise AssertionError(f"{run} has no process")
