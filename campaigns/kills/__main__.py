"""Kills during a campaign: `python -m campaigns.kills [--kills 50] [--nights 200] [--keep]`.

A campaign of nights is killed again and again: one of its workers, or every fifth time the command, which is then
repeated. At the end every night must have one result, equal to that of a campaign that nobody disturbed. Stopped, the
trial goes on in build/kills; --keep enters its outcome in campaigns/kills/results.tsv.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from bench.campaign.ledger import DIFFERING, RESULTS
from bench.campaign.program import ROOT, digest_of, identity
from bench.campaign.tasks import Result
from bench.files import append_line
from campaigns.night import ENVIRONMENT, code_of_now
from tests.support.campaign_tasks import workers_under

KEPT = ROOT / "campaigns" / "kills" / "results.tsv"
HEADER = "day\tcommit\tnights\tkills\tof workers\tof the command\tlost\tdouble\tdifferent"
OF_THE_COMMAND = 5  # each so-many-th kill
MOST_BETWEEN = 5  # results between two kills


class Nights:
    """A command that rehearses nights into a folder, killed and repeated until it ends by itself."""

    def __init__(self, folder: Path, nights: int, workers: int = 2) -> None:
        self.folder = folder
        words = ["faults", "smoke", "--bench", "simulated", "--seeds", str(nights), "--workers", str(workers)]
        self._command = [sys.executable, "-m", "bench", "campaign", *words, "--out", str(folder)]
        self._process: subprocess.Popen[bytes] | None = None

    def running(self) -> subprocess.Popen[bytes]:
        """The process, which is started if there is none."""
        if self._process is None or self._process.poll() is not None:
            environment = {**os.environ, **ENVIRONMENT, "PYTHONPATH": str(ROOT)}
            self._process = subprocess.Popen(
                self._command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
        return self._process

    def has_ended(self) -> bool:
        """True when the command has ended by itself; AssertionError if it has failed."""
        if self._process is None or self._process.poll() is None:
            return False
        assert self._process.returncode in (0, -signal.SIGKILL), self._process.returncode
        return self._process.returncode == 0

    def workers(self) -> list[int]:
        """Its workers."""
        return workers_under(self.running().pid)

    def done(self) -> int:
        """How many whole lines of results are there."""
        path = self.folder / RESULTS
        return path.read_bytes().count(b"\n") if path.exists() else 0


def main() -> int:
    """Exit status 1 when a result is lost, double or different."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--nights", type=int, default=200)
    parser.add_argument("--keep", action="store_true")
    options = parser.parse_args()
    folder = ROOT / "build" / "kills" / digest_of(identity())
    folder.mkdir(parents=True, exist_ok=True)
    killed = kill(Nights(folder / "killed", options.nights), folder / "kills.jsonl", options.kills)
    undisturbed = Nights(folder / "undisturbed", options.nights)
    assert undisturbed.running().wait() == 0
    found = compared(folder / "killed", folder / "undisturbed")
    print(f"{options.nights} nights, {dict(killed)} killed: " + ", ".join(f"{n} {what}" for what, n in found.items()))
    if options.keep:
        row = [f"{datetime.now(UTC):%Y-%m-%d}", code_of_now(), options.nights, killed.total(), killed["worker"]]
        if not KEPT.exists():
            append_line(KEPT, HEADER)
        append_line(KEPT, "\t".join(map(str, [*row, killed["command"], *found.values()])))
    return 1 if any(found.values()) else 0


def kill(nights: Nights, kills: Path, count: int) -> Counter[str]:
    """Kill until so many kills are in a file, or the nights have ended; how many of each."""
    carried_out = [json.loads(line) for line in kills.read_text("utf-8").splitlines()] if kills.exists() else []
    for number in range(len(carried_out), count):
        draw = np.random.default_rng(number)
        if not _wait(nights, nights.done() + int(draw.integers(1, MOST_BETWEEN + 1))):
            break
        what = "command" if number % OF_THE_COMMAND == OF_THE_COMMAND - 1 else "worker"
        workers = nights.workers()
        pid = nights.running().pid if what == "command" or not workers else int(draw.choice(workers))
        time.sleep(draw.uniform(0, 0.5))
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        if what == "command":
            nights.running().wait()
        carried_out.append({"number": number, "what": what, "done": nights.done()})
        append_line(kills, json.dumps(carried_out[-1]))
        print(f"kill {number + 1}: a {what}, at {carried_out[-1]['done']} results", flush=True)
    while not nights.has_ended():
        nights.running().wait()
    return Counter(each["what"] for each in carried_out)


def _wait(nights: Nights, count: int) -> bool:
    """Wait for so many results, with the command repeated if it was killed; False if the nights have ended."""
    while nights.done() < count:
        if nights.has_ended():
            return False
        nights.running()
        time.sleep(0.05)
    return True


def compared(folder: Path, undisturbed: Path) -> dict[str, int]:
    """How many results are lost, double, or not those of the undisturbed campaign."""
    found, wanted = list(_results(folder)), {each.task: each for each in _results(undisturbed)}
    times = Counter(each.task for each in found if each.is_finished)
    different = [each for each in found if each.is_finished and not each.agrees(wanted[each.task])]
    return {
        "lost": len(wanted.keys() - times.keys()),
        "double": sum(count > 1 for count in times.values()),
        "different": len(different) + (folder / DIFFERING).exists(),
    }


def _results(folder: Path) -> Iterator[Result]:
    for line in (folder / RESULTS).read_text("utf-8").splitlines():
        if (result := Result.of_line(line)) is not None:
            yield result


if __name__ == "__main__":
    sys.exit(main())
