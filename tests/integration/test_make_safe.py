"""`bench make-safe` on real processes and wires; a client that is no part of the program reads the instruments."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support import energised
from tests.support.energised import ENERGISED, HOT_C, SAFE, SAFE_C, Process, Wires, wires
from tests.support.guardians import guardian_of
from tests.support.killed import journal
from tests.support.runs import ROOT
from tests.support.served import free_port

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Iterator[Wires]:
    with wires(tmp_path_factory.mktemp("served")) as served:
        yield served


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> Path:
    """The records of a user of its own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state/inertial-test-bench"


def make_safe(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "bench", "make-safe", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=60)


def lanes(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    """How each lane ended, by role."""
    return {line.split()[0]: line[17:29].strip() for line in done.stdout.splitlines()}


def running(bench: Wires, folder: Path) -> Process:
    """A run that has energised the bench."""
    run = Process(bench.bench, folder)
    run.until_step("steps/wait")
    return run


def kill(run: Process) -> None:
    """Kill a run with its guardian, as a power cut does."""
    for process in (guardian_of(run.process.pid), run.process.pid):
        os.kill(process, signal.SIGKILL)
    assert run.process.wait(5) == -signal.SIGKILL


def killed(bench: Wires, folder: Path) -> str:
    """The name of a run that was killed while the bench was energised."""
    run = running(bench, folder)
    kill(run)
    assert run.path is not None
    assert bench.state() == ENERGISED
    return run.path.name


def test_what_a_killed_run_left_on_is_made_safe_without_naming_the_bench(bench, tmp_path, state):
    name = killed(bench, tmp_path)
    done = make_safe()
    assert done.returncode == 0, done.stderr
    assert bench.state() == SAFE
    assert name in done.stderr
    assert lanes(done) == dict.fromkeys(("chamber", "head", "source", "supply", "counter"), "safe")
    assert list((state / "energised").iterdir()) == []
    (line,) = (state / "made_safe.jsonl").read_text("utf-8").splitlines()
    assert {lane["role"]: lane["state"] for lane in json.loads(line)["lanes"]} == lanes(done)

    again = make_safe()
    assert again.returncode == 2
    assert "no run is on record" in again.stderr


def test_a_run_that_holds_the_bench_is_ended_and_records_why(bench, tmp_path):
    run = running(bench, tmp_path)
    done = make_safe("--bench", str(bench.bench))
    assert done.returncode == 0, done.stderr
    assert f"Ending a run of energised, process {run.process.pid}" in done.stderr
    assert bench.state() == SAFE
    assert run.code() == 4
    assert run.manifest()["ended_by"] == "terminate"


def test_one_instrument_that_is_not_there_delays_no_other_and_stays_on_record(bench, tmp_path, state):
    killed(bench, tmp_path)
    (entry,) = (state / "energised").iterdir()
    supply = json.loads(entry.read_text("utf-8"))["connections"]["supply"]
    absent = bench.edited(
        tmp_path / "other", "supply", lambda line: line.replace(supply, f"tcp://127.0.0.1:{free_port()}")
    )
    done = make_safe("--bench", str(absent))
    assert done.returncode == 6, done.stderr
    assert lanes(done)["supply"] == "not reached"
    assert "NOT MADE SAFE: supply" in done.stderr
    assert bench.state() == {**SAFE, "supply": True}
    assert list(json.loads(entry.read_text("utf-8"))["connections"].values()) == [supply]
    took_s = {line.split()[0]: float(line[29:36]) for line in done.stdout.splitlines()}
    assert max(taken for role, taken in took_s.items() if role != "supply") < 5
    assert make_safe().returncode == 0
    assert bench.state() == SAFE


def test_the_next_run_names_the_one_that_left_instruments_on_and_makes_them_safe_first(bench, tmp_path, state):
    name = killed(bench, tmp_path / "first")
    run = Process(bench.bench, tmp_path / "second", "--set", "time=1 s")
    assert run.code() == 0
    assert f"{name} ended without making" in run.told.read_text("utf-8")
    assert run.path is not None
    entries = journal(run.path)
    kinds = [entry.kind for entry in entries]
    assert kinds.index("found_left_on") < kinds.index("step_begins")
    found = entries[kinds.index("found_left_on")]
    assert found.data == {"devices": dict.fromkeys(("chamber", "head", "supply", "source"), name), "unsafe": {}}
    assert f"before the first step: chamber, head, source, supply ({name})" in (run.path / "report.html").read_text(
        "utf-8"
    )
    assert list((state / "energised").iterdir()) == []
    assert bench.state() == SAFE


def test_what_somebody_else_has_switched_on_is_recorded_and_made_safe_before_the_first_step(
    bench, tmp_path, monkeypatch
):
    waits_first = energised.SEQUENCE.replace("  - wait: 2 s\nsteps:", "steps:").replace(
        "setup:", "setup:\n  - wait: 5 s"
    )
    monkeypatch.setattr(energised, "SEQUENCE", waits_first)
    bench.energise()
    run = Process(bench.bench, tmp_path, "--set", "time=1 s")
    run.until_step("setup/wait")
    assert {role: bench.state_of(role) for role in ("chamber", "supply")} == {"chamber": SAFE_C, "supply": False}
    assert run.code() == 0
    assert run.path is not None
    entries = journal(run.path)
    kinds = [entry.kind for entry in entries]
    assert kinds.index("identified") < kinds.index("found_energised") < kinds.index("step_begins")
    assert "found_left_on" not in kinds
    found = entries[kinds.index("found_energised")].data["devices"]
    assert found.keys() == {"chamber", "supply", "source"}
    assert found["supply"]["voltage_v"] == pytest.approx(15, abs=0.1)
    assert found["source"]["current_a"] == pytest.approx(0.005)
    assert found["chamber"]["set_point_c"] == HOT_C
    assert "supply was found energised: output on, 15 V, " in (reported := run.told.read_text("utf-8"))
    assert "no run on record has left it in this state" in reported
    assert "Found energised, and made safe before the first step: chamber: set point 60 °C" in (
        run.path / "report.html"
    ).read_text("utf-8")
    assert bench.state() == SAFE


def test_a_bench_file_that_is_gone_is_named_and_no_success(bench, tmp_path):
    own = bench.edited(tmp_path / "own", "supply", str)
    run = Process(own, tmp_path)
    run.until_step("steps/wait")
    kill(run)
    own.unlink()
    done = make_safe()
    assert done.returncode == 6
    assert str(own) in done.stdout
    assert make_safe("--bench", str(bench.bench)).returncode == 0
    assert bench.state() == SAFE


def test_a_bench_is_locked_out_while_a_run_holds_it(bench, tmp_path):
    def lockout(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "bench", "lockout", "--bench", str(bench.bench), *arguments]
        return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=60)

    run = running(bench, tmp_path)
    done = lockout("--by", "A. Person", "--reason", "the coil is changed")
    assert done.returncode == 6, done.stderr
    assert run.code() == 6
    assert bench.state() == {**SAFE, "chamber": ENERGISED["chamber"]}
    assert "since somebody works at the bench" in run.manifest()["unsafe"]["chamber"]
    refused = Process(bench.bench, tmp_path / "refused")
    assert refused.code() == 3
    assert "locked out by A. Person" in refused.told.read_text("utf-8")
    assert lockout("--lift", "--reason", "done").returncode == 0
    assert make_safe("--bench", str(bench.bench)).returncode == 0
    assert bench.state() == SAFE
