"""`bench make-safe` says whether the air of a chamber has arrived, and with --wait follows it, over real wires."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.config.bench import load_bench
from bench.runner.held import LOOKS, energising_addresses, owners
from tests.support.energised import SAFE, Process, Wires, wires
from tests.support.guardians import guardian_of
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
WITHIN_S = 30.0
AWAY = {**SAFE, "chamber": 90.0}


@pytest.fixture
def served(tmp_path_factory) -> Iterator[Wires]:
    """A bench of its own, whose air has not been warmed by other tests."""
    with wires(tmp_path_factory.mktemp("served")) as found:
        yield found


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> Path:
    """The records of a user of its own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state/inertial-test-bench"


@pytest.fixture
def bench(served) -> Iterator[Wires]:
    """The bench, which is safe afterwards."""
    yield served
    make_safe("--bench", str(served.bench))


@pytest.fixture
def far(bench, tmp_path) -> Path:
    """The bench file with a safe set point that is far from where its air is."""
    return bench.edited(tmp_path / "own", "chamber", lambda line: line.replace("25 °C}", "90 °C}"))


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "bench", *arguments]


def make_safe(*arguments: str) -> subprocess.CompletedProcess[str]:
    words = command("make-safe", *arguments)
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False, timeout=90)


def _heeds_hangups() -> None:
    """The tests may have been started with nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


class Waiting:
    """`bench make-safe --wait` in a process of its own that has begun to follow it."""

    def __init__(self, far: Path) -> None:
        words = command("make-safe", "--bench", str(far), "--wait")
        self.process = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT, preexec_fn=_heeds_hangups
        )
        addresses, end_s = energising_addresses(load_bench(far).bench).values(), time.monotonic() + WITHIN_S
        while not any(each.process == self.process.pid for each in owners(addresses, LOOKS)):
            assert time.monotonic() < end_s
            time.sleep(0.1)
        time.sleep(2.0)  # looks

    def end(self) -> tuple[int, str]:
        """Its exit code, and what it has said."""
        try:
            reported = self.process.communicate(timeout=60)[1]
        finally:
            self.process.kill()
        return self.process.returncode, reported


def killed(bench: Path, folder: Path) -> Path:
    """The directory of a run that was killed with its guardian while the bench was energised."""
    run = Process(bench, folder)
    run.until_step("steps/wait")
    for process in (guardian_of(run.process.pid), run.process.pid):
        subprocess.run(["kill", "-KILL", str(process)], check=True)
    run.process.wait(5)
    assert run.path is not None
    return run.path


def followed(folder: Path) -> list[dict[str, Any]]:
    """The entries about the chamber."""
    lines = (folder / "followed.jsonl").read_text("utf-8").splitlines()
    return [entry for line in lines if (entry := json.loads(line))["role"] == "chamber"]


def events(folder: Path) -> list[str]:
    return [entry["event"] for entry in followed(folder)]


def test_what_is_on_its_way_is_told_with_how_to_look_and_is_in_the_record_of_the_run(bench, far, tmp_path, state):
    run = killed(far, tmp_path)
    done = make_safe()
    assert done.returncode == 0, done.stderr
    assert "on its way to the safe set point 90.0 °C" in done.stderr
    assert f"'bench make-safe --bench {far} --wait'" in done.stderr
    assert f"'bench devices --bench {far}'" in done.stderr
    assert bench.state() == AWAY
    assert events(run) == events(state) == ["commanded", "ended"]
    assert followed(run)[0]["by"] == "'bench make-safe'"


def test_with_wait_it_returns_when_the_air_has_arrived(bench, tmp_path, state):
    cool = bench.edited(tmp_path / "own", "chamber", lambda line: line.replace("25 °C}", "21 °C}"))  # where its air is
    run = killed(cool, tmp_path)
    done = make_safe("--wait")
    assert done.returncode == 0, done.stderr
    assert "chamber: its air arrived at the safe set point at " in done.stderr
    assert events(run) == events(state) == ["commanded", "arrived"]


def test_ctrl_c_ends_the_wait_and_leaves_the_chamber_as_commanded(bench, far, state):
    waiting = Waiting(far)
    waiting.process.send_signal(signal.SIGINT)
    code, reported = waiting.end()
    assert code == 4, reported
    assert "No longer followed: chamber. The safe set point stays commanded" in reported
    assert bench.state() == AWAY
    assert events(state) == ["commanded", "ended"]


def test_a_terminal_that_is_closed_ends_the_wait_with_that_on_record(bench, far, state):
    waiting = Waiting(far)
    waiting.process.stderr.close()
    waiting.process.send_signal(signal.SIGHUP)
    assert waiting.process.wait(30) in (3, 4)  # 3: what it says last is lost
    assert bench.state() == AWAY
    assert events(state) == ["commanded", "ended"]


def test_a_chamber_that_does_not_arrive_is_no_success(bench, far, state):
    waiting = Waiting(far)
    bench.energise()  # somebody commands it away
    code, reported = waiting.end()
    assert code == 6, reported
    assert "chamber: HAS NOT ARRIVED at the safe set point (" in reported
    assert "): the set point was changed by another master from 90 °C to 60 °C" in reported
    assert events(state) == ["commanded", "not_arrived"]


def test_a_run_that_begins_meanwhile_has_the_bench(bench, far, tmp_path, state):
    waiting = Waiting(far)
    run = Process(bench.bench, tmp_path, "--set", "time=1 s")
    code, reported = waiting.end()
    assert code == 0, reported
    assert "has taken the bench" in reported
    assert run.code() == 0
    assert "'bench make-safe' hands the bench over" in run.told.read_text("utf-8")
    assert events(state)[:2] == ["commanded", "handed_over"]


def test_a_chamber_that_a_guardian_follows_already_is_left_to_it(bench, far, tmp_path):
    run = Process(far, tmp_path)
    run.until_step("steps/wait")
    done = make_safe("--bench", str(far))
    assert done.returncode == 0, done.stderr
    assert run.code() == 4
    assert run.path is not None
    assert f"On its way, followed by the guardian of {run.path.name}, process " in done.stderr
    assert events(run.path) == ["commanded"]
    assert followed(run.path)[0]["by"] == f"the guardian of {run.path.name}"
