"""Ctrl-C, SIGTERM, kill -9 and a full disk, on a real process."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bench.clock import Stopwatch
from bench.reduce.stored_run import open_run
from bench.store.reader import RunReader
from bench.store.runs import summary
from tests.support.runs import LARGE, ROOT, SHORT

pytestmark = [pytest.mark.integration, pytest.mark.slow]
FEW_TEMPERATURES = [word for setting in SHORT for word in ("--set", setting)]
SHORT_STEPS = FEW_TEMPERATURES[2:]


class Running:
    """`bench run` as a process whose stderr is read line by line."""

    def __init__(self, runs: Path, *arguments: str, limit_bytes: int | None = None) -> None:
        def limit() -> None:
            if limit_bytes is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

        self.process = subprocess.Popen(
            [sys.executable, "-m", "bench", "run", *arguments, "--bench", "simulated", "--no-report", "--runs", runs],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, preexec_fn=limit,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        self.runs = runs
        self.lines: list[str] = []

    def until(self, text: str) -> None:
        """Reads stderr until a line holds `text`."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line)
            if text in line:
                return
        raise AssertionError("".join(self.lines))

    def finish(self) -> int:
        out, err = self.process.communicate(timeout=100)
        self.lines.append(err)
        self.out = out
        return self.process.returncode

    @property
    def said(self) -> str:
        return "".join(self.lines)

    @property
    def path(self) -> Path:
        return next(self.runs.iterdir())

    def steps_ended(self) -> list[str]:
        with RunReader(self.path) as reader:
            return [event.step for event in reader.events("step_ended")]

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def state(self) -> tuple[str, str]:
        manifest = json.loads((self.path / "manifest.json").read_text("utf-8"))
        return manifest["state"], manifest["verdict"]


@pytest.fixture
def started(tmp_path) -> Iterator[Callable[..., Running]]:
    """Starts runs below tmp_path, and ends what a failed test leaves."""
    runs: list[Running] = []

    def start(*arguments: str, **options: int) -> Running:
        runs.append(Running(tmp_path, *arguments, **options))
        return runs[-1]

    yield start
    for run in runs:
        run.close()


def soaking(run: Running) -> None:
    """Returns when the run is in its long soak, which takes minutes of real time."""
    run.until("of bench time, from")
    time.sleep(1.5)


def test_the_first_ctrl_c_ends_the_step_and_runs_the_teardown(started):
    run = started("smoke", "--speed", "60", "--set", "soak=2 h")
    soaking(run)
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 4
    assert "Stopping: teardown runs now and takes about" in run.said
    assert run.state() == ("aborted", "ABORTED")
    ended = run.steps_ended()
    assert ended[-2:] == ["teardown/set", "teardown/move"]
    assert "steps/temperature=20/soak" not in ended
    assert "Verdict: ABORTED" in run.out


def test_the_second_ctrl_c_drops_the_teardown_and_makes_everything_safe(started):
    run = started("tumble_static", "--speed", "120", *FEW_TEMPERATURES)
    soaking(run)
    run.process.send_signal(signal.SIGINT)
    run.until("Stopping")
    watch = Stopwatch()
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 4
    assert watch.elapsed_s() < 15
    assert "Aborting: no teardown" in run.said
    assert run.state() == ("aborted", "ABORTED")
    with RunReader(run.path) as reader:
        (safe,) = reader.events("made_safe")
    assert safe.data == {"unsafe": {}}


def test_sigterm_makes_everything_safe_without_teardown(started):
    run = started("smoke", "--speed", "60", "--set", "soak=2 h")
    soaking(run)
    run.process.terminate()
    assert run.finish() == 4
    assert "ended by SIGTERM: another program, or the shutdown of the computer" in run.said
    assert not any(step.startswith("teardown") for step in run.steps_ended())
    with RunReader(run.path) as reader:
        assert [event.data["unsafe"] for event in reader.events("made_safe")] == [{}]


def test_ctrl_c_is_heard_at_full_speed_too(started):
    run = started("tumble_static")
    run.until("%")
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 4
    assert run.steps_ended()[-1] == "teardown/soak"


def test_a_killed_run_is_interrupted_and_its_data_open(started):
    run = started("tumble_static", "--preset", "quick", *SHORT_STEPS)
    run.until("temperature=20#2")
    run.process.kill()
    run.finish()
    assert summary(run.path).state == "interrupted"
    listed = subprocess.run(
        [sys.executable, "-m", "bench", "runs", "--runs", str(run.runs)], capture_output=True, text=True, check=True,
        cwd=ROOT,
    ).stdout  # fmt: skip
    assert "interrupted" in listed
    with open_run(run.path) as stored:
        results = stored.evaluate()
        frames = stored.reader.frames_by_step()
        acquired = [event.step for event in stored.reader.events("step_ended") if "label" in event.data]
    assert results.verdict == "INCOMPLETE"
    assert len(results.units[0].findings) >= 3 * 3
    assert len(acquired) > 5
    for step in acquired:  # each was acknowledged before the next step began
        latches = (frames[step]["counter"].ids == 0x100).sum()
        assert 98 <= latches <= 101
    reported = subprocess.run(
        [sys.executable, "-m", "bench", "report", str(run.path)], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert reported.returncode == 0, reported.stderr
    assert "INCOMPLETE" in (run.path / "report.html").read_text("utf-8")


def test_a_full_disk_ends_the_run_in_words_with_the_bench_safe(started):
    large = [word for setting in LARGE for word in ("--set", setting)]
    run = started("tumble_static", *large, limit_bytes=4 * 1024 * 1024 + 4096)
    assert run.finish() == 3
    assert "the run store cannot write" in run.said
    assert "If the disk of the run directory is full, free some space" in run.said
    assert run.state() == ("error", "ERROR")
    with RunReader(run.path) as reader:
        assert len(list(reader.events("step_ended"))) >= 10
