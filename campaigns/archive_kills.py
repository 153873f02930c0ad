"""Pushes to a bucket that are killed at a random instant, again and again: nothing half visible, nothing twice.

Each trial pushes one of some runs to a bucket of moto or azurite, and kills the process a moment after one of the
objects or tables that it writes, drawn at random, whatever else the computer does. A run whose row is in the table
`runs` must be complete; at the end, each must be there once. `python -m campaigns.archive_kills --kills 200` continues
where it was, by `results.jsonl` of the folder.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from bench.archive.destination import Destination
from bench.archive.publish import push
from bench.archive.query import Archive, opened
from bench.clock import wall_utc
from bench.errors import InputError
from tests.support.buckets import BUCKETS, ROOT

RUNS = 8
LINES = "SELECT count(*) FROM all_{name} WHERE uuid = ?"


def made_runs(folder: Path) -> list[Path]:
    """Runs of the smoke sequence, made once."""
    for seed in range(RUNS - len(list(folder.glob("*_smoke_*")))):
        words = ("run", "smoke", "--seed", str(seed), "--runs", str(folder), "--no-report")
        subprocess.run([sys.executable, "-m", "bench", *words], check=True, capture_output=True, cwd=ROOT)
    return sorted(folder.glob("*_smoke_*"))


def expected(run: Path) -> dict[str, int]:
    """Number of rows that a run has in each table."""
    findings = json.loads((run / "results.json").read_text())["findings"]
    manifest = json.loads((run / "manifest.json").read_text())
    return {
        "runs": 1, "findings": len(findings), "budgets": sum(len(each["budget"]) for each in findings),
        "instruments": len(manifest["instruments"]),
    }  # fmt: skip


def wrong(archive: Archive, runs: list[Path], *, all_there: bool) -> Iterator[str]:
    """What is half visible or twice there, and with `all_there` what is missing."""
    for run in runs:
        uuid = json.loads((run / "manifest.json").read_text())["uuid"]
        found = {name: archive.query(LINES.format(name=name), [uuid]).rows[0][0] for name in expected(run)}
        absent = not any(found.values())
        if found != expected(run) and (all_there or not absent):
            yield f"{run.name}: {found}, expected {expected(run)}"


def pushing(run: Path, url: str) -> subprocess.Popen[str]:
    """A process that pushes a run and prints the name of each object and table once it is there."""
    words = [sys.executable, "-m", "campaigns.archive_kills", "--push", str(run), url]
    return subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def killed(run: Path, url: str, after: int, then_s: float) -> bool:
    """Kill a push so many seconds after so many names; return whether it was still running."""
    with pushing(run, url) as process:
        assert process.stdout is not None
        for _ in zip(range(after), process.stdout, strict=False):
            pass
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(then_s)
            return False
        process.send_signal(signal.SIGKILL)
        return True


def campaign(folder: Path, store: str, kills: int, seed: int) -> int:
    """Carry out the trials that are missing; return the number of those that went wrong."""
    rng, results = random.Random(seed), folder / "results.jsonl"
    done = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    count = sum(each["was_running"] for each in done)
    runs = made_runs(folder / "runs")
    with BUCKETS[store](folder / "store") as bucket:
        os.environ.update(bucket.variables)
        begun = time.monotonic()
        with pushing(runs[0], f"{bucket.url}-first-{len(done)}") as process:
            assert process.stdout is not None
            times_s = [time.monotonic() - begun for _ in process.stdout]
        between_s = (times_s[-1] - times_s[0]) / len(times_s)
        problems, number = 0, len(done)
        while count < kills:
            url = f"{bucket.url}-{number // RUNS}-{len(done)}"
            run = runs[number % RUNS]
            was_running = killed(run, url, rng.randrange(len(times_s)), rng.uniform(0.0, 2.0 * between_s))
            count += was_running
            with contextlib.suppress(InputError):  # before the first push has begun the archive there is nothing to see
                problems += _noted(results, number, was_running, list(wrong(opened(url), runs, all_there=False)))
            if number % RUNS == RUNS - 1 or count == kills:
                chosen = runs[: number % RUNS + 1]
                whole = [sys.executable, "-m", "bench", "archive", "push", *map(str, chosen), url]
                subprocess.run(whole, check=True, capture_output=True, cwd=ROOT)
                found = list(wrong(opened(url), chosen, all_there=True))
                problems += _noted(results, number, False, found)
                print(f"{wall_utc():%H:%M:%S} {count} kills, {problems} wrong", flush=True)
            number += 1
    return problems


def _noted(results: Path, number: int, was_running: bool, found: list[str]) -> int:
    line = {"kill": number, "was_running": was_running, "wrong": found, "at": f"{wall_utc():%Y-%m-%d %H:%M:%S}"}
    with results.open("a") as file:
        file.write(f"{json.dumps(line)}\n")
    return len(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "archive_kills")
    parser.add_argument("--store", choices=sorted(BUCKETS), default="moto")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--push", nargs=2, metavar=("RUN", "URL"), help="what a trial does before it is killed")
    given = parser.parse_args()
    if given.push:
        push(Path(given.push[0]), Destination(given.push[1]), watch=lambda name: print(name, flush=True))
        return
    (given.folder / "runs").mkdir(parents=True, exist_ok=True)
    sys.exit(1 if campaign(given.folder, given.store, given.kills, given.seed) else 0)


if __name__ == "__main__":
    main()
