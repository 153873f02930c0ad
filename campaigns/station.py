"""Deaths of a station: `python -m campaigns.station --kills 200`, by hand.

Three actors submit, hold, release, move, cancel and clone items while runs go on, and `bench serve` is killed with
SIGKILL at random moments. Afterwards each item that was answered must be there once, in the state that was answered or
a later one. Each that was not cancelled must have exactly one run, which is undamaged and has ended with PASS. There
must be no other item and no other run.

Each round has a folder and a line in build/station/results.tsv. A campaign that was stopped continues: rounds of today
count. `--histories 2000` instead plays histories of the queue under three actors, without processes.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.client import Station
from bench.client.http import NoReply, NoStation
from bench.errors import BenchError, InputError, StaleError
from bench.station.queue.attempts import look
from bench.store.runs import RunSummary, list_runs
from bench.store.verify import examine
from tests.support.queue_history import WAITING, faults_of_items

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "station"
HEADER = ("date", "seed", "kills", "under way", "answers", "items", "runs", "faults")
STATION = "schema: itb-station/1\nbenches:\n  a: {file: simulated}\n  b: {file: simulated}\n"
BENCHES = ("a", "b")
ACTORS, KILLS, ITEMS = 3, 20, 18  # of a round
FIRST_ITEMS = 4  # that are accepted before the first death
UP_AT_MOST_S = 6.0
STEPS = 50
STARTS_WITHIN_S, ENDS_WITHIN_S = 60.0, 600.0


@dataclass
class Answered:
    """What a station has answered: items by id in their newest version, and the number of answers."""

    items: dict[str, dict[str, Any]] = field(default_factory=dict)
    answers: int = 0
    unanswered_clones: int = 0
    faults: list[str] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def note(self, item: dict[str, Any]) -> None:
        with self.lock:
            self.answers += 1
            known = self.items.get(item["id"])
            if known is None or item["version"] >= known["version"]:
                self.items[item["id"]] = item

    def copy(self) -> dict[str, dict[str, Any]]:
        with self.lock:
            return dict(self.items)


def faults_of_runs(items: list[dict[str, Any]], runs: list[RunSummary]) -> Iterator[str]:
    """Faults of the runs, after all items have ended."""
    tickets = Counter(str(run.manifest.get("request", {}).get("ticket", "")) for run in runs)
    for item in items:
        expected = {"ended": 1, "cancelled": 0}.get(item["state"])
        if expected is None:
            yield f"item {item['number']} is {item['state']}: {item['reason']}"
        elif tickets[item["id"]] != expected:
            yield f"item {item['number']} is {item['state']} and has {tickets[item['id']]} runs"
    for ticket in tickets.keys() - {item["id"] for item in items}:
        yield f"a run has the ticket '{ticket}', which is no item"
    for run in runs:
        if (verdict := run.manifest.get("verdict")) != "PASS" or run.state != "completed":
            yield f"run {run.id} is {run.state}, {verdict}"
        if damage := examine(run.path, thoroughly=False).damage:
            yield f"run {run.id} is damaged: {damage[0]}"


class Actor(threading.Thread):
    """Person or program that changes the queue until `over`, whatever happens to the station."""

    def __init__(self, folder: Path, seed: int, answered: Answered, items: int) -> None:
        super().__init__(daemon=True)
        self._folder, self._draw, self._answered, self._left = folder, random.Random(seed), answered, items
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.wait(self._draw.uniform(0.0, 0.1)):
            try:
                station = Station.found(self._folder, limit_s=STARTS_WITHIN_S)
                self._act(station)
            except (NoStation, NoReply, StaleError):
                continue  # it is dead, or another actor was faster
            except (InputError, BenchError) as problem:
                self._answered.faults.append(f"{problem}")

    def _act(self, station: Station) -> None:
        known = [item for item in self._answered.copy().values() if item["state"] in WAITING]
        if self._left and (len(known) < 3 or self._draw.random() < 0.1):
            self._submit(station)
        elif known:
            self._change(station, self._draw.choice(known), self._draw.choice(known))

    def _submit(self, station: Station) -> None:
        self._left -= 1
        more = {"speed": self._draw.choice(("4", "20", "max")), "priority": self._draw.randint(-1, 1)}
        self._answered.note(station.submit("smoke", self._draw.choice(BENCHES), held=self._draw.random() < 0.3, **more))

    def _change(self, station: Station, item: dict[str, Any], other: dict[str, Any]) -> None:
        version = item["version"] if self._draw.random() < 0.7 else None
        change = self._draw.choices(("hold", "release", "move", "cancel", "clone", "look"), (3, 3, 3, 0.05, 0.1, 2))[0]
        if change == "move":
            self._answered.note(station.move(item["id"], None if other is item else other["id"], version))
        elif change == "clone" and self._left:
            self._clone(station, item)
        elif change == "look":
            self._answered.note(station.item(item["id"]))
        elif change != "clone":
            self._answered.note(getattr(station, change)(item["id"], version))

    def _clone(self, station: Station, item: dict[str, Any]) -> None:
        self._left -= 1
        try:
            self._answered.note(station.clone(item["id"]))
        except NoReply:
            self._answered.unanswered_clones += 1
            raise


class Round:
    """Station in a folder of its own, killed again and again while actors use it."""

    def __init__(self, folder: Path, seed: int, kills: int, items: int = ITEMS) -> None:
        self.folder, self._kills, self._draw, self._port = folder, kills, random.Random(seed), _free_port()
        self.answered, self.killed, self.under_way = Answered(), 0, 0  # under way: runs at the moments of the deaths
        self.items: list[dict[str, Any]] = []
        self.runs: list[RunSummary] = []
        seeds = range(seed * 100, seed * 100 + ACTORS)
        self._actors = [Actor(folder / "station", each, self.answered, items // ACTORS) for each in seeds]

    def play(self) -> list[str]:
        """Play the round; return its faults."""
        self.folder.mkdir(parents=True)
        (self.folder / "station.yaml").write_text(STATION)
        for actor in self._actors:
            actor.start()
        for _ in range(self._kills):
            process = self._started()
            if not self.killed:
                self._until(process, lambda: len(self.answered.items) >= FIRST_ITEMS)
            if self._draw.random() < 0.1:
                time.sleep(self._draw.uniform(0.0, 1.5))  # while it starts
            else:
                self._look(process)
                time.sleep(self._draw.uniform(0.0, UP_AT_MOST_S))
            self.under_way += sum(look(claim.parent).lives for claim in self.folder.glob("station/items/*/*/claim"))
            process.kill()
            process.wait()
            self.killed += 1
        process = self._started()
        try:
            self._end(process)
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(30)
        return list(dict.fromkeys(self.answered.faults))

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        station = self._look(process)
        for actor in self._actors:
            actor.over.set()
            actor.join(2 * STARTS_WITHIN_S)
        self._look(process)
        for item in station.queue():
            if item["item"]["state"] == "held":
                station.release(item["item"]["id"])
        until = time.monotonic() + ENDS_WITHIN_S
        while station.queue() and not self._has_stopped(station) and time.monotonic() < until:
            time.sleep(0.5)
        self.items = self._listed(station)
        self.runs = list(list_runs(self.folder / "runs"))
        faults = [*faults_of_items(self.answered.copy(), self.items), *faults_of_runs(self.items, self.runs)]
        if (more := len(self.items) - len(self.answered.items)) > self.answered.unanswered_clones:
            faults.append(f"{more} items were never answered")
        self.answered.faults += faults

    def _started(self) -> subprocess.Popen[bytes]:
        words = ["serve", "station.yaml", "--folder", "station", "--runs", "runs", "--port", str(self._port)]
        with (self.folder / "messages.txt").open("ab") as messages:
            return subprocess.Popen(
                [sys.executable, "-m", "bench", *words], cwd=self.folder, stdout=messages, stderr=messages
            )

    def _look(self, process: subprocess.Popen[bytes]) -> Station:
        """Wait until the station has started, and compare its items with what was answered."""
        before = self.answered.copy()
        self._until(process, self._answers)
        station = Station.found(self.folder / "station")
        listed = self._listed(station)
        self.answered.faults += faults_of_items(before, listed)
        for item in listed:
            self.answered.note(item)
        return station

    def _answers(self) -> bool:
        try:
            return bool(Station.found(self.folder / "station").me())
        except (NoStation, NoReply):
            return False

    def _until(self, process: subprocess.Popen[bytes], holds: Callable[[], bool]) -> None:
        until = time.monotonic() + STARTS_WITHIN_S
        while not holds():
            if process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"the station does not work: {self.folder / 'messages.txt'}")
            time.sleep(0.05)

    @staticmethod
    def _has_stopped(station: Station) -> bool:
        return any(bench["stopped"] for bench in station.state()["benches"])

    @staticmethod
    def _listed(station: Station) -> list[dict[str, Any]]:
        return [each["item"] for each in station.queue(past=True)]


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def play_histories(count: int) -> int:
    """Play histories of the queue; a fault is shown with the shortest history that has it."""
    from hypothesis import HealthCheck, settings
    from hypothesis.stateful import run_state_machine_as_test

    from tests.support.queue_machine import QueueMachine

    health = list(HealthCheck)
    wanted = settings(max_examples=count, stateful_step_count=STEPS, deadline=None, suppress_health_check=health)
    run_state_machine_as_test(QueueMachine, settings=wanted)
    print(f"{count} histories of up to {STEPS} steps: ok")
    return 0


def rounds_of_today() -> list[list[str]]:
    file = KEPT / "results.tsv"
    lines = file.read_text().splitlines()[1:] if file.exists() else []
    return [line.split("\t") for line in lines if line.startswith(f"{datetime.now(UTC):%Y-%m-%d}")]


def note(round_: Round, seed: int) -> None:
    KEPT.mkdir(parents=True, exist_ok=True)
    file, answered = KEPT / "results.tsv", round_.answered
    counts = (round_.killed, round_.under_way, answered.answers, len(round_.items), len(round_.runs))
    row = (f"{datetime.now(UTC):%Y-%m-%d}", seed, *counts)
    with file.open("a") as lines:
        if not lines.tell():
            lines.write("\t".join(HEADER) + "\n")
        lines.write("\t".join(map(str, (*row, len(set(answered.faults))))) + "\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="of today, in all rounds")
    parser.add_argument("--histories", type=int, default=0, help="of the queue, instead of deaths")
    options = parser.parse_args()
    if options.histories:
        return play_histories(options.histories)
    faults = 0
    while (done := sum(int(row[2]) for row in rounds_of_today())) < options.kills:
        seed = len(rounds_of_today()) + 1
        folder = KEPT / f"round-{seed}"
        shutil.rmtree(folder, ignore_errors=True)
        round_ = Round(folder, seed, min(KILLS, options.kills - done))
        found = round_.play()
        note(round_, seed)
        counts = f"{round_.killed} kills with {round_.under_way} runs under way, {len(round_.runs)} runs"
        print(f"round {seed}: {counts}", flush=True)
        for sentence in found:
            print(f"    {sentence}", flush=True)
        faults += len(found)
        if not found:
            shutil.rmtree(folder)
    rows = rounds_of_today()
    sums = ", ".join(f"{sum(int(row[at]) for row in rows)} {HEADER[at]}" for at in range(2, len(HEADER)))
    print(f"{len(rows)} rounds today: {sums}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
