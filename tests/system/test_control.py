"""Commands to a run that is under way, from another process, over its control socket."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bench.store.reader import RunReader
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
PACED = ("smoke", "--speed", "20", "--set", "soak=1 min")


class Running:
    """`bench run` as a process, found again by its run directory."""

    def __init__(self, runs: Path, *arguments: str) -> None:
        self.runs = runs
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bench", "run", *arguments, "--bench", "simulated", "--runs", str(runs)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        self.wait_for(lambda: bool(list(runs.glob("*/runner.json"))))
        (self.path,) = runs.iterdir()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        for _ in range(400):
            if condition():
                return
            time.sleep(0.05)
        raise AssertionError("it did not come to pass within 20 s")

    def tell(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "bench", words[0], "last", *words[1:], "--runs", str(self.runs)],
            capture_output=True, text=True, check=False, cwd=ROOT, timeout=30,
        )  # fmt: skip

    def steps(self, kind: str) -> list[str]:
        with RunReader(self.path) as reader:
            return [event.step for event in reader.events(kind)]

    def operator(self) -> list[str]:
        """What the operator did: held and released the run, or what his action is called."""
        with RunReader(self.path) as reader:
            events = reader.events("held", "released", "operator")
            return [event.data.get("action", event.kind) for event in events]

    def finish(self) -> int:
        self.process.communicate(timeout=40)
        return self.process.returncode


@pytest.fixture
def started(tmp_path) -> Iterator[Callable[..., Running]]:
    runs: list[Running] = []

    def start(*arguments: str) -> Running:
        runs.append(Running(tmp_path, *arguments))
        return runs[-1]

    yield start
    for run in runs:
        if run.process.poll() is None:
            run.process.kill()
        run.process.communicate()


def test_a_paused_run_holds_before_its_next_step_goes_on_and_stops_after_a_step(started):
    run = started(*PACED)
    told = run.tell("pause")
    assert told.stdout == f"{run.path.name}: it pauses before its next step\n"
    run.wait_for(lambda: run.operator() == ["held"])
    held = run.steps("step_begins")
    time.sleep(1.0)  # twenty seconds of bench time
    assert run.steps("step_begins") == held
    assert run.tell("resume").stdout.endswith(": it goes on\n")
    run.wait_for(lambda: run.steps("step_begins") != held)
    assert run.tell("stop", "--after-step").stdout.endswith(": teardown runs after the step under way\n")
    assert run.finish() == 4
    assert run.operator() == ["held", "released", "stop"]
    assert run.steps("step_ended") == run.steps("step_begins"), "no step was cut short"
    assert run.steps("step_ended")[-2:] == ["teardown/set", "teardown/move"]


def test_a_stop_ends_the_step(started):
    run = started("smoke", "--speed", "20", "--set", "soak=1 h")
    run.wait_for(lambda: "steps/temperature=20/soak" in run.steps("step_begins"))
    assert run.tell("stop").stdout.endswith(": the step under way ends, teardown runs\n")
    assert run.finish() == 4
    assert "steps/temperature=20/soak" not in run.steps("step_ended")
    assert "teardown/set" in run.steps("step_ended")


def test_a_paused_run_can_be_aborted(started):
    run = started(*PACED)
    run.tell("pause")
    run.wait_for(lambda: run.operator() == ["held"])
    assert run.tell("abort").stdout.endswith(": the teardown is dropped, all devices are made safe\n")
    assert run.finish() == 4
    assert not [step for step in run.steps("step_begins") if step.startswith("teardown")]
    with RunReader(run.path) as reader:
        assert [event.data for event in reader.events("made_safe")] == [{"unsafe": {}}]


def test_at_full_speed_there_is_no_pause_but_a_stop(started):
    run = started("tumble_static")
    told = run.tell("pause")
    assert told.returncode == 2
    assert "in virtual time at full speed nothing can be paused; run it with --speed 60, say" in told.stderr
    assert run.tell("stop").returncode == 0
    assert run.finish() == 4


def test_a_run_that_is_over_takes_no_commands_and_leaves_no_socket(started):
    run = started("smoke")
    address = json.loads((run.path / "runner.json").read_text("utf-8"))["socket"]
    assert Path(address).stat().st_mode & 0o077 == 0 or Path(address).parent.stat().st_mode & 0o077 == 0
    assert run.finish() == 0
    assert not Path(address).exists()
    assert not (run.path / "runner.json").exists()
    told = run.tell("stop")
    assert told.returncode == 2
    assert told.stderr == f"{run.path.name}: this run is not under way, it is completed\n"


def test_a_killed_run_is_told_to_be_interrupted(started):
    run = started(*PACED)
    run.process.kill()
    run.process.communicate()
    told = run.tell("resume")
    assert told.returncode == 2
    assert told.stderr == f"{run.path.name}: this run is not under way, it is interrupted\n"


def test_nonsense_is_answered_with_what_is_known_and_the_silent_keep_nobody_waiting(started):
    run = started(*PACED)
    address = json.loads((run.path / "runner.json").read_text("utf-8"))["socket"]
    silent = [socket.socket(socket.AF_UNIX) for _ in range(5)]
    for client in silent:
        client.connect(address)
    for line in (b"\n", b"{}\n", b'{"command": "dance"}\n', b"[" * 4000 + b"\n", b"\xff\n", b"x" * 9000):
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(5)
            client.connect(address)
            client.sendall(line)
            answer = json.loads(client.makefile("rb").readline())
        assert answer == {"refused": "expected one of pause, resume, stop, stop_after_step, abort"}
    began_s = time.monotonic()
    assert run.tell("abort").returncode == 0
    assert time.monotonic() - began_s < 5
    for client in silent:
        client.close()
    assert run.finish() == 4
    assert (run.path / "results.json").exists()
