"""Aborts in real time: until they are accepted, and until every instrument is safe, beside bluesky-queueserver.

Each abort ends a `bench run` whose instruments are at the end of sockets and pseudo-terminals, at an instant that is
drawn: in a soak, a move or an acquisition. The times to safe are of its record.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from bench.config.load import load_file
from bench.config.models import BenchFile
from bench.rig import limits_to_make_safe
from bench.runner.tell import send_command
from bench.store.reader import RunReader
from benchmarks.compared import Row, Side
from benchmarks.peers import figures, version_of
from tests.support.served import on_real_wires, simulating
from tests.support.under_way import bench_run, wait_until

WHOLE, SLICE = 100, 10
ACCEPTED_WITHIN_S = 0.25
LATEST_S = 5.5  # after the first step: a soak, a move, an acquisition
AS_SHORT = ("--uut", "QF-0001", "--set", "soak=1 s", "--set", "gate=2 s")
QUEUE = "queueserver"


def measure(whole: bool) -> Iterator[Row]:
    """Two rows: acceptance, and safe state."""
    count = WHOLE if whole else SLICE
    draws = random.Random(1)
    with tempfile.TemporaryDirectory() as name:
        bench = on_real_wires(Path(name))
        limits_s = limits_to_make_safe(load_file(bench, BenchFile))
        with simulating(bench):
            first = [abort_s(bench, Path(name) / f"runs{each}", draws) for each in range(count // 2)]
            theirs = figures(QUEUE, "queueserver_abort.py", str(count))
            rest = [abort_s(bench, Path(name) / f"runs{each}", draws) for each in range(count // 2, count)]
    accepted_s, safe_s = zip(*first, *rest, strict=True)
    peer = f"bluesky-queueserver {version_of(QUEUE, 'bluesky-queueserver')}"
    work = f"{count} aborts of a run in real time"
    yield _row(
        f"{work}: until accepted", accepted_s, (peer, theirs["accepted_s"]), "executed before the disk",
        f"p99 ≤ {ACCEPTED_WITHIN_S * 1e3:g} ms", _p99(accepted_s) <= ACCEPTED_WITHIN_S,
    )  # fmt: skip
    within_s = min(limits_s.values())
    yield _row(
        f"{work}: until all {len(limits_s)} instruments are safe", safe_s, (peer, theirs["done_s"]),
        "read back, and on the disk; what switches off is sent at once",
        f"all ≤ {within_s:g} s, the shortest limit of an instrument", max(safe_s) <= within_s,
    )  # fmt: skip


def abort_s(bench: Path, runs: Path, draws: random.Random) -> tuple[float, float]:
    """How long an abort took to be accepted, and how long until the instruments were safe, both in s."""
    runs.mkdir()
    with bench_run(runs, "smoke", *AS_SHORT, bench=str(bench)) as run:
        wait_until(lambda: run.begun("ramp"))
        time.sleep(draws.uniform(0.0, LATEST_S))
        began_s = time.perf_counter()
        send_command(run.path, "abort")
        accepted_s = time.perf_counter() - began_s
        status, said = run.finish()
    with RunReader(run.path) as reader:
        (asked,) = (each for each in reader.events("command") if each.data["command"] == "abort")
        (safe,) = reader.events("made_safe")
    if safe.data["unsafe"]:
        raise RuntimeError(f"exit {status}, not safe: {safe.data['unsafe']}\n{said}")
    return accepted_s, accepted_s + safe.at_s - asked.at_s


def _row(
    work: str, ours: Sequence[float], peer: tuple[str, Sequence[float]], kept: str, goal: str, is_met: bool
) -> Row:  # fmt: skip
    name, theirs = peer
    return Row(
        "P8", work, "ms", _side(f"inertial-test-bench {version('inertial-test-bench')}", ours, kept),
        (_side(name, theirs, "Redis without a disk"),), "", goal, is_met,
    )  # fmt: skip


def _side(name: str, values_s: Sequence[float], kept: str) -> Side:
    return Side(name, f"{kept}; p99 {_p99(values_s) * 1e3:.0f} ms", tuple(each * 1e3 for each in values_s))


def _p99(values: Sequence[float]) -> float:
    """The largest but one in a hundred; of fewer, the largest."""
    return sorted(values)[-1 - len(values) // 100]
