"""Commands and scripts at a station: through it where it knows the run, and past it where it hangs."""

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from bench.client import Station
from bench.clock import Stopwatch
from tests.support.how_to import FOLDER
from tests.support.station import serving

pytestmark = [pytest.mark.integration, pytest.mark.slow]
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
ABORT_LIMIT_S, STARTS_WITHIN_S = 1.0, 4.0  # the latter for a process on a busy machine


@contextmanager
def own_station(tmp_path, monkeypatch):
    """Yield the station of this user, and its client."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "state/inertial-test-bench"
    folder.mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with serving(folder) as served:
        yield served, Station.found()


def bench(*words, **variables):
    done = subprocess.run(
        [sys.executable, "-m", "bench", *words], capture_output=True, text=True, timeout=120,
        env={**os.environ, **variables}, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def begun(served, station, item):
    """Wait until the run of an item takes commands, and return its name."""
    run = served.until(lambda: station.item(item["id"])["run"])
    served.until((served.folder / "runs" / run / "runner.json").exists)
    return run


def test_the_example_of_the_page_runs_as_written(tmp_path, monkeypatch):
    (example,) = PYTHON.findall((FOLDER / "script_a_station.md").read_text("utf-8"))
    with own_station(tmp_path, monkeypatch) as (_, station):
        done = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, timeout=120)
        assert done.stderr == ""
        lines = done.stdout.splitlines()
        assert lines[0] == "run_begins "
        assert "run_ended " in lines
        assert lines[-2:] == ["1 ended PASS", "2 ended PASS"]
        assert [run["units"] for run in station.runs()] == [["QF-0002"], ["QF-0001"]]


def test_a_queue_is_submitted_to_listed_and_changed_by_commands(tmp_path, monkeypatch):
    assert bench("submit", "smoke", XDG_STATE_HOME=str(tmp_path))[::2] == (
        2, "no station runs for this user; 'bench serve' starts one, or set BENCH_STATION and BENCH_TOKEN\n"
    )  # fmt: skip
    with own_station(tmp_path, monkeypatch) as (_, station):
        assert bench("submit", "smok")[0] == 2
        assert (
            bench("submit", "smoke", "--hold", "--uut", "QF-1", "--speed", "max")[1] == "item 1 is held at bench demo\n"
        )
        assert bench("queue", "clone", "1")[0] == 0
        assert bench("queue", "hold", "2")[0] in (0, 3)  # it may have begun
        code, out, _ = bench("submit", "smoke", "--speed", "max", "--set", "gate=5 s", "--wait", "--bench", "demo")
        assert (code, out.rstrip().rpartition(": ")[2]) == (0, "completed, PASS")
        assert bench("queue", "cancel", "1") == (0, "item 1 is cancelled, priority 0\n", "")
        assert bench("queue", "release", "1")[0] == 3
        listed = bench("queue", "--past")[1]
        assert re.search(r"^1 +cancelled +demo +smoke QF-1 ", listed, re.MULTILINE)
        assert station.item(station.queue(past=True)[-1]["item"]["id"])["submission"]["settings"] == {"gate": "5 s"}


def test_a_run_is_commanded_and_watched_through_the_station_that_knows_it(tmp_path, monkeypatch):
    with own_station(tmp_path, monkeypatch) as (served, station):
        item = station.submit("smoke", "demo", speed="5")
        run = begun(served, station, item)
        assert bench("pause", "last") == (
            0, f"{run}: the run pauses before its next step\n", f"through the station {station.url}\n"
        )  # fmt: skip
        assert bench("resume", run)[::2] == (0, f"through the station {station.url}\n")
        elsewhere = {  # a computer that has neither its folder nor its runs
            "XDG_STATE_HOME": str(tmp_path), "BENCH_STATION": served.url,
            "BENCH_TOKEN": station.new_token("script", ["read", "stop"]),
        }  # fmt: skip
        assert bench("skip", "last", **elsewhere)[0] == 2
        with subprocess.Popen(
            [sys.executable, "-m", "bench", "watch"], env={**os.environ, **elsewhere}, stdout=subprocess.PIPE, text=True
        ) as watching:
            assert "run begins" in watching.stdout.readline()
            assert bench("stop", "last", **elsewhere)[::2] == (0, f"through the station {station.url}\n")
            lines = watching.communicate(timeout=60)[0].splitlines()
        assert watching.returncode == 4
        assert lines[-1] == f"{run}: aborted, ABORTED"
        assert station.wait(item["id"])["verdict"] == "ABORTED"
        made = [each["action"] for each in served.get("audit") if each["action"] in ("pause", "resume", "skip", "stop")]
        assert made == ["pause", "resume", "stop"]


def test_an_abort_does_not_wait_for_a_station_that_hangs(tmp_path, monkeypatch):
    with own_station(tmp_path, monkeypatch) as (served, station):
        item = station.submit("smoke", "demo", speed="1")
        run = begun(served, station, item)
        served.process.send_signal(signal.SIGSTOP)
        try:
            watch = Stopwatch()
            code, out, said = bench("abort", "last")
            took_s = watch.elapsed_s()
        finally:
            served.process.send_signal(signal.SIGCONT)
        assert code == 0
        assert out.startswith(f"{run}: ")
        assert "has not answered" in said
        assert "sent directly" in said
        assert ABORT_LIMIT_S <= took_s < ABORT_LIMIT_S + STARTS_WITHIN_S
        assert station.wait(item["id"], limit_s=30)["outcome"] == "aborted"


def test_users_and_tokens_are_changed_with_and_without_a_station(tmp_path, monkeypatch):
    password = tmp_path / "password"
    password.write_text("correct horse\n")
    password.chmod(0o600)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    add = ("users", "add", "anna", "--role", "operator", "--password-file", str(password))
    assert bench(*add) == (0, "user anna: operator\n", "")
    folder = tmp_path / "state/inertial-test-bench"
    with serving(folder, has_users=True) as served:
        station = Station.found()
        login = {"name": "anna", "password": "correct horse"}
        assert served.client.post("/api/v1/login", json=login).status_code == 200
        assert bench("users", "add", "boris", "--role", "viewer")[0] == 2  # not on a terminal
        password.chmod(0o644)
        assert "chmod 600" in bench("users", "add", "boris", *add[3:])[2]
        secret = bench("tokens", "new", "script", "--scope", "read")[1].strip()
        assert Station(served.url, secret).me()["scopes"] == ["read"]
        (token,) = [each["id"] for each in station.tokens() if each["label"] == "script"]
        assert bench("tokens", "revoke", token)[1] == f"token {token}: revoked\n"
        assert bench("users", "remove", "anna")[::2] == (0, f"through the station {station.url}\n")
        assert served.client.post("/api/v1/login", json=login).status_code == 422
        made = [each["action"] for each in served.get("audit")]
        assert made == ["set user", "log in", "new token", "revoke token", "remove user"]
    assert bench("users", "remove", "anna")[0] == 2
