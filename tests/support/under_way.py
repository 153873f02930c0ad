"""`bench run` as a process of its own, found by its run directory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.store.reader import RunReader
from tests.support.runs import ROOT


@dataclass
class UnderWay:
    """A run under way; `path` is its directory."""

    process: subprocess.Popen[str]
    path: Path

    def finish(self, limit_s: float = 60.0) -> tuple[int, str]:
        """Exit status and what was said on stderr, when it has ended."""
        _, message = self.process.communicate(timeout=limit_s)
        return self.process.returncode, message

    def begun(self, step: str) -> bool:
        """Return whether a step with this in its id has begun, as far as the disk knows."""
        with RunReader(self.path) as reader:
            return any(step in event.step for event in reader.events("step_begins"))


def wait_until(condition: Callable[[], bool], limit_s: float = 30.0) -> None:
    """Return when the condition is true; AssertionError when it is not in time."""
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            raise AssertionError(f"it did not come to pass within {limit_s:g} s")
        time.sleep(0.05)


@contextmanager
def bench_run(
    runs: Path, *arguments: str, bench: str = "simulated", program: Sequence[str] = ("-m", "bench")
) -> Iterator[UnderWay]:
    """Start a run in a process group of its own; inside it takes commands, and afterwards it is gone."""
    process = subprocess.Popen(
        [sys.executable, *program, "run", *arguments, "--no-report", "--bench", bench, "--runs", str(runs)],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        start_new_session=True, env={**os.environ, "USER": "tired"},
    )  # fmt: skip
    try:
        wait_until(lambda: bool(list(runs.glob("*/runner.json"))) or process.poll() is not None)
        (path,) = runs.iterdir()
        yield UnderWay(process, path)
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
