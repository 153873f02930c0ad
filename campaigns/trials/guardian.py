"""Processes that are killed or stand still in every phase of a run: the bench is read by itself afterwards."""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path

from campaigns.trials.rows import Row
from campaigns.trials.signals import PHASES, row_of, sample
from tests.support.energised import Process, Wires, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe

WAYS = ("run killed", "run stands still", "guardian killed")
ENERGISED = ("setup", "steps", "teardown")
REPEATED = 5
WITHIN_S = 40.0  # the lease, the kill, and the longest lane
AS_WISHED = "safe, and on record"


def trials(scale: float) -> Iterator[Row]:
    """A row for each way in which a run loses itself or its guardian."""
    with tempfile.TemporaryDirectory() as folder, wires(Path(folder)) as bench:
        for way in WAYS:
            some = sample(list(product(ENERGISED, range(REPEATED))), scale)
            tried = [(phase, partial(_lost, way, phase, number)) for phase, number in some]
            yield row_of(f"{way} in {len(ENERGISED)} phases", tried, bench, AS_WISHED)


def _lost(way: str, phase: str, number: int, bench: Wires, folder: Path) -> str:
    """Problem after it; "" for none."""
    arguments, wait = PHASES[phase]
    run = Process(bench.bench, folder, *arguments)
    wait(run)
    time.sleep(0.15 * number)
    guardian = guardian_of(run.process.pid)
    victim = guardian if way == "guardian killed" else run.process.pid
    with contextlib.suppress(ProcessLookupError):
        os.kill(victim, signal.SIGSTOP if way == "run stands still" else signal.SIGKILL)
    end_s = time.monotonic() + WITHIN_S
    while run.process.poll() is None or not (has_made_safe(run.path) or has_ended(guardian)):
        if time.monotonic() > end_s:
            run.process.kill()
            return f"not within {WITHIN_S:g} s; {run.told.read_text('utf-8')[-300:]}"
        time.sleep(0.1)
    if way == "guardian killed":
        return "" if run.process.returncode == 4 else f"exit code {run.process.returncode}"
    assert run.path is not None
    incident = run.path / "incident.jsonl"
    return "" if incident.exists() and '"unsafe": {}' in incident.read_text("utf-8") else "no record of a rescue"
