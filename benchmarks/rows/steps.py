"""P3: what a step costs besides what it does, each with its journal on the disk before anything of it begins."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.compared import ROUNDS, Row, Side, in_turn
from benchmarks.peers import figures, version_of
from benchmarks.timed_run import CONFIG, Timed, timed_run

SEQUENCE = """\
schema: itb-sequence/1
title: Steps that do nothing
needs: {{}}
steps:
  - repeat: {count}
    steps: [note: Nothing.]
"""
OWN_CPU_US = 120
OWN_ROUNDS = 15  # for processor time, which differs by a third with the processor that each thread wakes on
DURABLE = "each step synced"
PEERS: dict[str, tuple[str, str, *tuple[str, ...]]] = {
    "bluesky, plain device": ("bluesky", "bluesky_steps.py", "2000", "plain"),
    "bluesky, ophyd-async": ("bluesky", "bluesky_steps.py", "1000", "ophyd-async"),
    "openhtf": ("openhtf", "openhtf_steps.py", "500"),
    "hardpy": ("hardpy", "hardpy_steps.py", "60"),
    "bluesky-queueserver": ("queueserver", "queueserver_steps.py", "5"),
    "dbos": ("dbos", "dbos_steps.py", "500"),
}
DURABILITY = {
    "bluesky, plain device": "JSON lines, not synced",
    "bluesky, ophyd-async": "JSON lines, not synced",
    "openhtf": "JSON at the end",
    "hardpy": "JSON, not synced; 60 cases",
    "bluesky-queueserver": "queue in Redis, not synced",
    "dbos": "SQLite, each step synced",
}
NO_REDIS = "bluesky-queueserver was not measured: there is no redis-server (on Debian: apt install redis-server)"


def measure(whole: bool) -> Iterator[Row]:
    """Steps a second beside programs that are not durable, beside one that is, and own processor time a step."""
    count, missing = (9_000 if whole else 2000), "" if shutil.which("redis-server") else NO_REDIS
    names = [each for each in PEERS if not (missing and each == "bluesky-queueserver")]
    spent: list[tuple[float, float]] = []  # processor time in µs of a step and of a bare commit
    commits_us: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        steps(folder, 2)

        def ours() -> float:
            step = each(steps(folder, count + 1), steps(folder, 2), count)
            wall_us, cpu_us = commits(folder, count)
            commits_us.append(wall_us)
            spent.append((step.cpu_s * 1e6, cpu_us))
            return 1.0 / step.wall_s

        found = in_turn({"ours": ours, **{each: partial(peer_steps_per_s, each) for each in names}})
        for _ in range(OWN_ROUNDS - ROUNDS):
            ours()
    limit = f"bare commit of SQLite: {median(commits_us):.0f} µs, {1e6 / median(commits_us):,.0f} commits/s; {missing}"
    side = Side("this program", DURABLE, found["ours"])
    peers = {each: Side(title(each), DURABILITY[each], found[each]) for each in names}
    for what, wanted, goal, factor in (
        ("a step with its journal, beside peers that keep nothing safe", peers.keys() - {"dbos"}, "more than each", 1),
        ("a step with its journal, beside a durable peer", {"dbos"}, "≥ 5 ×", 5),
    ):
        beside = tuple(peer for each, peer in peers.items() if each in wanted)
        row = Row("P3", what, "steps/s", side, beside, limit.removesuffix("; "), goal, True, lower_is_better=False)
        yield judged(row, factor)
    yield own_time(spent)


def judged(row: Row, factor: float) -> Row:
    """The row with its goal met or not."""
    return Row(**{**vars(row), "is_met": all(row.ratio(peer) > factor for peer in row.peers)})


def own_time(spent: list[tuple[float, float]]) -> Row:
    """Processor time of a step above that of a bare commit."""
    side = Side("this program", DURABLE, tuple(step_us - commit_us for step_us, commit_us in spent))
    bare = f"bare commit: {median(commit_us for _, commit_us in spent):.0f} µs of processor"
    goal = f"≤ {OWN_CPU_US} µs"
    return Row(
        "P3", "processor time of a step above a bare commit", "µs", side, (), bare, goal, side.value <= OWN_CPU_US
    )


def steps(folder: Path, count: int) -> Timed:
    """A run with so many steps that do nothing."""
    sequence = folder / f"s{count}.yaml"
    sequence.write_text(SEQUENCE.format(count=count), "utf-8")
    return timed_run(sequence, CONFIG / "simulated.yaml", folder / "runs")


def each(many: Timed, few: Timed, count: int) -> Timed:
    """One of `count` steps, from runs with and without them."""
    return Timed((many.wall_s - few.wall_s) / count, (many.cpu_s - few.cpu_s) / count, 0.0, many.path)


def commits(folder: Path, count: int) -> tuple[float, float]:
    """Wall and processor time in µs of a row in a transaction of its own, with the settings of the run store."""
    path = folder / "bare.db"
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA synchronous=FULL")
    database.execute("CREATE TABLE journal(seq INTEGER PRIMARY KEY, text TEXT)")
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    for number in range(count):
        database.execute("BEGIN IMMEDIATE")
        database.execute("INSERT INTO journal VALUES (?, ?)", (number, "a row of the journal"))
        database.execute("COMMIT")
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    database.close()
    return wall_s / count * 1e6, cpu_s / count * 1e6


def peer_steps_per_s(name: str) -> float:
    """One measurement of a peer. Raises RuntimeError if DBOS does not keep each step as the table says."""
    environment, script, *given = PEERS[name]
    found: dict[str, Any] = figures(environment, script, *given)
    if name == "dbos" and found["synchronous"] < 2:
        raise RuntimeError(f"DBOS does not sync each step: {found}")
    return float(found["steps_per_s"])


def title(name: str) -> str:
    """A peer with its version."""
    package, _, how = name.partition(", ")
    return f"{package} {version_of(PEERS[name][0], package)}{f', {how}' if how else ''}"
