"""Runs on a simulated bench that are killed at an instant of virtual time, and runs that go on after it.

As a program: the process that is killed, told as JSON what to run.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from bench.app.drawn_faults import with_drawn_faults
from bench.app.execute import RunResult, execute
from bench.app.request import RunRequest, prepare
from bench.app.resume import prepare_again, read_interrupted
from bench.clock import Clock
from bench.runner.quiet import Quiet
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.plan.dwells import first_visit
from bench.sequence.plan.plan import PlannedStep
from bench.store.reader import Event, RunReader
from tests.support.runs import ROOT

KILLED = 137


class Killed(Quiet):
    """An observer with which the process ends, without another instruction, at an instant of bench time.

    One that is `at_latest` ends when the teardown begins, where that is earlier.
    """

    def __init__(self, at_s: float, *, at_latest: bool = False) -> None:
        super().__init__()
        self._at_s, self._at_latest = at_s, at_latest

    def run_begins(self, path: Path, expected: Estimate, clock: Clock) -> None:
        asyncio.get_running_loop().call_at(self._at_s, os._exit, KILLED)

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        if self._at_latest and planned.phase == "teardown":
            os._exit(KILLED)


def interrupted(runs: Path, at_s: float, sequence: Path | str, bench: Path | str, **options: Any) -> Path:
    """The directory of a run that was killed at an instant of bench time; `options` are as in `run_short`."""
    asked = {"sequence": str(sequence), "bench": str(bench), "runs": str(runs), "no_report": True, **options}
    _killed({"at_s": at_s, "asked": asked})
    return max(runs.iterdir())


def interrupted_again(path: Path, at_s: float) -> None:
    """Resume an interrupted run and kill it once more, at the latest when its teardown begins."""
    _killed({"at_s": at_s, "again": str(path)})


def _killed(wish: dict[str, Any]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.killed", json.dumps(wish)],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == KILLED, f"{done.returncode} {done.stdout}{done.stderr[-600:]}"


def resumed(path: Path, quiet: Quiet | None = None) -> RunResult:
    """An interrupted run that has gone on to its end."""
    resumption = read_interrupted(path)
    return execute(prepare_again(resumption), quiet or Quiet(), None, resumption)


def journal(path: Path) -> list[Event]:
    """Its entries."""
    with RunReader(path) as reader:
        return list(reader.events())


def ended(entries: list[Event]) -> Counter[str]:
    """Number of times each step ended, by its id in the plan."""
    return Counter(first_visit(entry.step) for entry in entries if entry.kind == "step_ended")


def main(wish: dict[str, Any]) -> None:
    """Run, or resume, until killed."""
    observer = Killed(wish["at_s"], at_latest="again" in wish)
    if "again" in wish:
        resumed(Path(wish["again"]), observer)
        return
    asked = wish["asked"]
    for key in ("settings", "units"):
        asked[key] = tuple(asked.get(key, ()))
    asked |= {key: Path(asked[key]) for key in ("runs", "scenario") if key in asked}
    rehearsed = asked.pop("rehearsed", None)
    prepared = prepare(RunRequest(**asked))
    execute(prepared if rehearsed is None else with_drawn_faults(prepared, rehearsed), observer)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
