"""A run on a simulated bench, with the time that its loop takes: without the start of the program and the report."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bench.app import execute as app
from bench.app.request import RunRequest, prepare
from bench.cli.collection import uncollected
from bench.loop import run as run_loop
from bench.runner.quiet import Quiet

CONFIG = Path(__file__).parents[1] / "config"


@dataclass(frozen=True)
class Timed:
    """What a run took."""

    wall_s: float
    cpu_s: float  # of all threads of this process
    bench_s: float
    path: Path


def timed_run(sequence: str | Path, bench: str | Path, runs: Path, settings: tuple[str, ...] = ()) -> Timed:
    """Do a run in virtual time. Raises SystemExit with its problems if it does not complete.

    Objects of earlier runs are collected first, so that the run starts as in a new process.
    """
    gc.unfreeze()
    gc.collect()
    with uncollected():
        prepared = prepare(RunRequest(str(sequence), bench=str(bench), settings=settings, runs=runs, no_report=True))
    took: list[float] = []

    def measured(*given: Any) -> Any:
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        try:
            return run_loop(*given)
        finally:
            took.extend((time.perf_counter() - wall_s, time.process_time() - cpu_s))

    with patch.object(app, "run_loop", measured):
        result = app.execute(prepared, Quiet())
    if result.outcome.how != "completed":
        raise SystemExit("\n".join(result.problems))
    wall_s, cpu_s = took
    return Timed(wall_s, cpu_s, result.bench_s, result.path)
