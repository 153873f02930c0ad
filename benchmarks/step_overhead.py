"""What a step costs besides what it does: journal, commit, state, beside bare commits of SQLite on the same disk."""

from __future__ import annotations

import sqlite3
import tempfile
import time
from pathlib import Path

from bench.app import execute as app
from bench.app.request import RunRequest, prepare
from bench.loop import run as run_loop
from bench.runner.quiet import Quiet

STEPS = 2000
ROOT = Path(__file__).parents[1]
SEQUENCE = """\
schema: itb-sequence/1
title: Steps that do nothing
needs: {{}}
steps:
  - repeat: {count}
    steps: [note: Nothing.]
"""


def run_s(folder: Path, count: int) -> float:
    """Wall time of the run itself, without its report, with so many steps that do nothing."""
    path = folder / f"s{count}.yaml"
    path.write_text(SEQUENCE.format(count=count), "utf-8")
    request = RunRequest(str(path), bench=str(ROOT / "config" / "simulated.yaml"), runs=folder / "runs")
    prepared = prepare(request)
    took_s = []

    def timed(main: object, speed: float) -> object:
        began_s = time.perf_counter()
        result = run_loop(main, speed)
        took_s.append(time.perf_counter() - began_s)
        return result

    app.run_loop = timed
    app.execute(prepared, Quiet())
    return took_s[0]


def commits_s(folder: Path, count: int) -> float:
    """The same number of rows, each in a transaction of its own, with the settings of the run store."""
    database = sqlite3.connect(folder / "bare.db", isolation_level=None)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA synchronous=FULL")
    database.execute("CREATE TABLE journal(seq INTEGER PRIMARY KEY, text TEXT)")
    began_s = time.perf_counter()
    for number in range(count):
        database.execute("BEGIN IMMEDIATE")
        database.execute("INSERT INTO journal VALUES (?, ?)", (number, "a row of the journal"))
        database.execute("COMMIT")
    return time.perf_counter() - began_s


def main() -> None:
    """Prints both, and their ratio."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_s(folder, 1)
        step_us = (run_s(folder, STEPS + 1) - run_s(folder, 2)) / STEPS * 1e6
        commit_us = commits_s(folder, STEPS) / STEPS * 1e6
    print(f"step    {step_us:6.0f} µs")
    print(f"commit  {commit_us:6.0f} µs   bare SQLite, WAL, synchronous=FULL")
    print(f"ratio   {step_us / commit_us:6.1f}")


if __name__ == "__main__":
    main()
