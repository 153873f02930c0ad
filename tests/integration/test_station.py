"""A station as users have it: its process dies and starts again, runs go on; the queue waits for a run by hand."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from tests.support.runs import ROOT
from tests.support.served import on_real_wires, simulating
from tests.support.station import serving

STATION = """\
schema: itb-station/1
title: Laboratory 3
benches:
  a: {file: simulated}
sequences: own
"""
pytestmark = [pytest.mark.integration, pytest.mark.slow]


def test_items_run_one_after_the_other_and_their_events_are_streamed(tmp_path):
    with serving(tmp_path) as station:
        first, second = station.submit(speed="20"), station.submit(units={"a": "QF-0001"})
        (waiting,) = [each for each in station.get("queue") if each["item"]["id"] == second["id"]]
        assert waiting["begins"] is not None
        ended = station.ended(first)
        assert (ended["verdict"], ended["outcome"]) == ("PASS", "completed")
        assert station.ended(second)["verdict"] == "PASS"
        runs = station.get("runs", text="qf-0001")
        assert [run["item"] for run in runs] == [second["id"]]
        with station.client.stream(
            "GET", f"/api/v1/runs/{runs[0]['run']}/events", headers={"last-event-id": "3"}
        ) as stream:
            lines = [line for line in stream.iter_lines() if line.startswith(("id:", "event:"))]
        ids = [int(line.partition(":")[2]) for line in lines if line.startswith("id:")]
        assert ids == list(range(4, ids[-1] + 1))
        assert lines[-3:] == [f"id: {ids[-1]}", "event: run_ended", "event: end"]


def test_a_run_outlives_the_station_and_is_found_again(tmp_path):
    with serving(tmp_path) as station:
        first, second = station.submit(speed="20"), station.submit()
        station.until(lambda: station.get(f"queue/{first['id']}")["run"])
        station.process.kill()
        station.process.wait()
    with serving(tmp_path) as station:
        assert station.ended(first)["verdict"] == "PASS"
        assert station.ended(second)["verdict"] == "PASS"
        assert len(station.get("runs")) == 2


def test_a_sequence_that_has_become_wrong_is_refused_with_its_lines(tmp_path):
    (tmp_path / "own").mkdir()
    sequence = shutil.copy(ROOT / "sequences/smoke.yaml", tmp_path / "own/mine.yaml")
    (tmp_path / "station.yaml").write_text(STATION)
    with serving(tmp_path, "station.yaml") as station:
        item = station.post("queue?held=true", {"sequence": "mine", "bench": "a", "speed": "max"})
        sequence.write_text(sequence.read_text().replace("- move:", "- mvoe:"))
        assert station.post(f"queue/{item['id']}/release", {"version": item["version"]})["state"] == "queued"
        ended = station.ended(item)
        assert ended["state"] == "refused"
        assert re.search(r"mine\.yaml:\d+:\d+: .*mvoe", ended["reason"])
        wrong = station.client.post("/api/v1/queue", json={"sequence": "mine", "bench": "a"})
        assert wrong.status_code == 422
        assert "mvoe" in wrong.json()["detail"]


def test_a_run_that_was_started_by_hand_is_named_and_waited_for(tmp_path):
    bench = on_real_wires(tmp_path)
    with simulating(bench), serving(tmp_path, "--bench", str(bench)) as station:
        by_hand = subprocess.Popen(
            [sys.executable, "-m", "bench", "run", "smoke", "--bench", str(bench), "--uut", "a=HAND", "--runs", "own"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        )  # fmt: skip
        try:
            assert by_hand.stderr is not None
            while "about" not in by_hand.stderr.readline():
                assert by_hand.poll() is None
            name = bench.stem
            item = station.submit(bench=name, units={"a": "QF-1"}, speed="1")
            reason = station.until(lambda: station.get(f"queue/{item['id']}")["reason"])
            assert reason.startswith(f"waits for a run of smoke, process {by_hand.pid}")
            by_hand.send_signal(signal.SIGINT)
            by_hand.communicate(timeout=60)
            run = station.until(lambda: station.get(f"queue/{item['id']}")["run"])
            assert station.post(f"runs/{run}/abort")["answer"]
            assert station.ended(item)["outcome"] == "aborted"
        finally:
            with suppress(ProcessLookupError):
                os.kill(by_hand.pid, signal.SIGKILL)
            by_hand.communicate()


def test_the_code_of_the_first_login_is_good_once(tmp_path):
    with serving(tmp_path) as station:
        own = {"authorization": "", "origin": station.url.rstrip("/")}
        login = station.client.post("/api/v1/login/code", json={"code": station.code}, headers=own)
        assert login.status_code == 200, login.text
        cookie = login.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        again = station.client.post("/api/v1/login/code", json={"code": station.code}, headers=own)
        assert again.status_code == 422


def test_a_run_whose_files_have_changed_since_its_submission_is_refused(tmp_path):
    (tmp_path / "own").mkdir()
    sequence = shutil.copy(ROOT / "sequences/smoke.yaml", tmp_path / "own/mine.yaml")
    (tmp_path / "station.yaml").write_text(STATION)
    with serving(tmp_path, "station.yaml") as station:
        item = station.post("queue?held=true", {"sequence": "mine", "bench": "a", "speed": "max"})
        sequence.write_text(sequence.read_text() + "# a note\n")
        station.post(f"queue/{item['id']}/release")
        assert "has changed since this run was submitted" in station.ended(item)["reason"]
        again = station.ended(station.post(f"queue/{item['id']}/clone"))
        assert again["verdict"] == "PASS"
