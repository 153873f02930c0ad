"""Runs on a computer that stands still for a while, or has much else to do: none may end by it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from campaigns.trials.rows import Row
from tests.support.guardians import guardian_of
from tests.support.served import on_real_wires, simulating
from tests.support.under_way import UnderWay, bench_run, wait_until

STOPPED_S = 30.0
BURNING = 20
LIMIT_S = 8.0  # on what a thread answers in virtual time, in place of two minutes
IMPATIENT = (
    "import bench.loop, bench.store.writer; "
    f"bench.loop.THREAD_ANSWER_LIMIT_S = bench.store.writer.SLOW_DISK_S = {LIMIT_S}; "
    "from bench.cli.main import run; run()"
)
BURN = "while True: pass"


def trials(scale: float) -> Iterator[Row]:
    """The run with its instruments stopped, the run alone, a run in virtual time, and a busy computer."""
    times, stopped_s = max(1, round(3 * scale)), max(3.0, STOPPED_S * min(1.0, scale))
    ways: tuple[tuple[str, Callable[[float], str]], ...] = (
        ("run, guardian and instruments stopped", with_instruments),
        ("run and guardian stopped", alone),
        (f"a simulated night stopped, threads with {LIMIT_S:g} s", simulated),
    )
    for line, trial in ways:
        results = [trial(stopped_s) for _ in range(times)]
        yield _row(f"{line} for {stopped_s:g} s", results)
    yield _row(f"{BURNING} other programs at work", [burning() for _ in range(times)])


def _row(line: str, results: Sequence[str]) -> Row:
    bad = [result for result in results if result]
    return Row(line, len(results), f"{len(results) - len(bad)} passed" + "".join(f"; {each}" for each in bad), not bad)


def with_instruments(stopped_s: float) -> str:
    """Stop a run over real wires together with its guardian and its instruments; why it did not pass."""
    with wired() as (run, simulators):
        stand_still((run.pid, guardian_of(run.pid), simulators.pid), stopped_s)
        return _why(run)


def alone(stopped_s: float) -> str:
    """Stop a run over real wires and its guardian, as a computer that stands still; the instruments go on."""
    with wired() as (run, _):
        stand_still((run.pid, guardian_of(run.pid)), stopped_s)
        return _why(run)


def simulated(stopped_s: float) -> str:
    """Stop a run at full speed that waits for its threads for a few seconds only."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder)
        with bench_run(runs, "tumble_static", "--preset", "quick", program=("-c", IMPATIENT)) as run:
            time.sleep(1.0)
            stand_still((run.process.pid,), stopped_s)
            return _why_of(run)


def burning() -> str:
    """A run over real wires while other programs take all that there is."""
    with wired() as (run, _), ExitStack() as others:
        for _ in range(BURNING):
            other = others.enter_context(subprocess.Popen([sys.executable, "-c", BURN]))
            others.callback(other.kill)
        return _why(run)


@contextmanager
def wired() -> Iterator[tuple[subprocess.Popen[str], subprocess.Popen[str]]]:
    """A run over real wires that has begun to soak, and what serves its instruments."""
    with tempfile.TemporaryDirectory() as folder:
        bench = on_real_wires(Path(folder))
        with simulating(bench) as simulators:
            words = ("smoke", "--uut", "QF-0001", "--set", "soak=4 s", "--set", "gate=2 s")
            with bench_run(Path(folder) / "runs", *words, bench=str(bench)) as run:
                wait_until(lambda: run.begun("soak") or run.process.poll() is not None, 120.0)
                yield run.process, simulators


def stand_still(processes: Sequence[int], stopped_s: float) -> None:
    """Stop processes, and lets them go on."""
    for sign, wait_s in ((signal.SIGSTOP, stopped_s), (signal.SIGCONT, 0.0)):
        for process in processes:
            os.kill(process, sign)
        time.sleep(wait_s)


def _why(process: subprocess.Popen[str]) -> str:
    _, said = process.communicate(timeout=300)
    return "" if process.returncode == 0 else f"exit {process.returncode}: {said[-300:]!r}"


def _why_of(run: UnderWay) -> str:
    code, said = run.finish(300.0)
    return "" if code == 0 else f"exit {code}: {said[-300:]!r}"
