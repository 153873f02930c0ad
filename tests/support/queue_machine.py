"""Queue and scheduler of a station under three actors, processes of runs, and deaths of the station, for Hypothesis.

The processes of runs are claims and locks that the machine holds; all else is what `bench serve` uses.
"""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from bench.clock import wall_utc
from bench.errors import StaleError
from bench.station.queue import attempts, scheduler
from bench.station.queue.attempts import claim
from bench.station.queue.items import Item, ItemState, Submission
from bench.station.queue.scheduler import Scheduler
from bench.station.queue.table import Queue
from bench.station.runs.catalogue import Catalogue
from bench.station.settings import Settings
from bench.station.storage.database import Database
from bench.store.runs import LOCK, MANIFEST
from tests.support.queue_history import faults_of_items
from tests.support.runs import ROOT

BENCHES = ("a", "b")
ACTORS = ("anna", "boris", "chen")
MEMORY = Path("/dev/shm")
_MANIFEST = {
    "state": "running", "verdict": None, "title": "", "sequence": "smoke", "bench": "", "operator": "", "ended": None,
    "wall_s": None, "bench_s": None, "preset": None, "parameters": {}, "seed": 0, "simulated": [], "units": [],
    "instruments": {}, "hashes": {}, "software": {}, "problems": [],
    "host": dict.fromkeys(("name", "python", "system"), ""),
}  # fmt: skip
_read: dict[str, Any] = {}  # bench files, which take long to read

who, which, benches = st.sampled_from(ACTORS), st.integers(0, 30), st.sampled_from(BENCHES)


class Killed(BaseException):
    """Death of the station."""


class Process:
    """Process of an attempt: it has locked and claimed its folder, and writes a run."""

    def __init__(self, attempt: Path, runs: Path, number: int) -> None:
        self.ticket = attempt.parent.name
        assert f"--ticket={self.ticket}" in json.loads((attempt / attempts.COMMAND).read_bytes())["words"]
        self._locks = [_locked(attempt / attempts.LOCK)]
        self.lives = claim(attempt)
        if not self.lives:
            self._release()
            return
        self.run = runs / f"{wall_utc():%Y%m%dT%H%M%SZ}_smoke_{number}"
        self.run.mkdir(parents=True)
        self._locks.append(_locked(self.run / LOCK))
        self._write(state="running")

    def end(self) -> None:
        """End the run with PASS."""
        self._write(state="completed", verdict="PASS")
        self._release()
        self.lives = False

    def _write(self, **facts: Any) -> None:
        started = wall_utc().isoformat()
        content = {**_MANIFEST, "run": self.run.name, "started": started, "request": {"ticket": self.ticket}, **facts}
        (self.run / MANIFEST).write_text(json.dumps(content))

    def _release(self) -> None:
        while self._locks:
            os.close(self._locks.pop())


class QueueMachine(RuleBasedStateMachine):
    """Three actors, who may have seen items in older versions; processes that begin late, never, or twice."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="queue", dir=MEMORY if MEMORY.is_dir() else None))
        self.settings = Settings(
            "", self.folder / "station", self.folder / "runs",
            dict.fromkeys(BENCHES, ROOT / "config/simulated.yaml"), dict.fromkeys(BENCHES, ""),
        )  # fmt: skip
        self.loop = asyncio.new_event_loop()
        self.loop.set_default_executor(ThreadPoolExecutor(1))
        self.answered: dict[str, dict[str, Any]] = {}
        self.seen: dict[tuple[str, str], int] = {}  # versions by actor and item
        self.keys: dict[str, str] = {}
        self.launched: list[Path] = []
        self.processes: list[Process] = []
        self.dies = ""
        self.start()

    def start(self) -> None:
        self.database = Database(self.settings.folder)
        self.queue = Queue(self.database)
        self.scheduler = Scheduler(self.settings, self.queue, Catalogue(self.settings.runs), self.launch)
        self.scheduler._benches = _read

    def launch(self, folder: Path) -> None:
        """Start a process, which begins when its rule comes, or never; the station may die before or after it."""
        if self.dies == "before the process":
            raise Killed
        self.launched.append(folder)
        if self.dies == "after the process":
            raise Killed

    def prepare(self, *arguments: Any) -> None:
        if self.dies == "before the folder":
            raise Killed
        _prepare(*arguments)

    def teardown(self) -> None:
        for process in self.processes:
            process._release()
        self.database.close()
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()
        shutil.rmtree(self.folder)

    @rule(by=who, bench=benches, priority=st.integers(-1, 1), held=st.booleans(), key=st.sampled_from(["", "k1", "k2"]))
    def submit(self, by: str, bench: str, priority: int, held: bool, key: str) -> None:
        submission = Submission(sequence="smoke", bench=bench, priority=priority)
        # The key of a person is that of one submission.
        key = f"{key}-{by}-{bench}-{priority}" if key else ""
        item = self.queue.submit(submission, by, key=key, held=held)
        if key and (known := self.keys.setdefault(key, item.id)) != item.id:
            raise AssertionError(f"{key} is item {known} and {item.id}")
        self.note(by, item)

    @rule(by=who, n=which)
    def look_at(self, by: str, n: int) -> None:
        if (item := self.chosen(n)) is not None:
            self.note(by, item)

    @rule(by=who, n=which, change=st.sampled_from(["hold", "release", "cancel"]))
    def change(self, by: str, n: int, change: str) -> None:
        calls: dict[str, Callable[[str, int], Item]] = {
            "hold": lambda id_, version: self.queue.hold(id_, by, version),
            "release": self.queue.release,
            "cancel": lambda id_, version: self.queue.cancel(id_, by, version),
        }
        self.changed(by, n, calls[change])

    @rule(by=who, n=which, before=st.one_of(st.none(), which))
    def move(self, by: str, n: int, before: int | None) -> None:
        target = self.chosen(before) if before is not None else None
        self.changed(by, n, lambda id_, version: self.queue.move(id_, target.id if target else None, version))

    @rule(by=who, n=which)
    def clone(self, by: str, n: int) -> None:
        if (item := self.chosen(n)) is not None:
            self.note(by, self.queue.submit(item.submission, by))

    @rule(begin=st.booleans())
    def look(self, begin: bool) -> None:
        """Look, and let all processes begin that are launched; otherwise they begin later or never."""
        self.looked()
        while begin and self.launched:
            self.began(self.launched.pop())

    @rule(dies=st.sampled_from(["before the folder", "before the process", "after the process", "at rest"]))
    def station_dies(self, dies: str) -> None:
        self.dies = dies
        self.looked()
        self.dies = ""
        self.database.close()
        self.start()

    @precondition(lambda self: self.launched)
    @rule(n=which)
    def process_begins(self, n: int) -> None:
        attempt = self.launched.pop(n % len(self.launched))
        self.began(attempt)

    @precondition(lambda self: any(process.lives for process in self.processes))
    @rule(n=which)
    def run_ends(self, n: int) -> None:
        alive = [process for process in self.processes if process.lives]
        alive[n % len(alive)].end()

    @invariant()
    def history_is_complete(self) -> None:
        listed = [item.model_dump(mode="json") for item in self.queue.items()]
        assert list(faults_of_items(self.answered, listed)) == []
        assert {item["id"] for item in listed} == set(self.answered)
        self.answered = {item["id"]: item for item in listed}

    @invariant()
    def one_run_for_an_item_and_one_at_a_bench(self) -> None:
        bench = {item.id: item.submission.bench for item in self.queue.items()}
        runs = Counter(process.ticket for process in self.processes)
        alive = Counter(bench[process.ticket] for process in self.processes if process.lives)
        assert {*runs.values(), *alive.values()} <= {1}

    @invariant()
    def what_has_ended_had_its_run(self) -> None:
        ended = {process.ticket for process in self.processes if not process.lives}
        for item in self.queue.items(ItemState.ENDED):
            assert item.id in ended
            assert (item.outcome, item.verdict) == ("completed", "PASS")

    def changed(self, by: str, n: int, call: Callable[[str, int], Item]) -> None:
        """Change an item in the version that somebody has seen; an older one must be refused, and change nothing."""
        if (item := self.chosen(n)) is None:
            return
        version = self.seen.get((by, item.id), item.version)
        try:
            self.note(by, call(item.id, version))
        except StaleError:
            assert self.queue.item(item.id) == item
        else:
            assert version == item.version
            assert item.state in (ItemState.QUEUED, ItemState.HELD)

    def began(self, attempt: Path) -> None:
        process = Process(attempt, self.settings.runs, len(self.processes))
        if process.lives:
            self.processes.append(process)

    def chosen(self, n: int) -> Item | None:
        ids = sorted(self.answered, key=lambda id_: self.answered[id_]["number"])
        return self.queue.item(ids[n % len(ids)]) if ids else None

    def note(self, by: str, item: Item) -> None:
        self.seen[by, item.id] = item.version
        self.answered[item.id] = item.model_dump(mode="json")

    def looked(self) -> None:
        with _at_once(), patch.object(attempts, "prepare", self.prepare):
            try:
                self.loop.run_until_complete(self.scheduler.look())
            except Killed:
                assert self.dies


_prepare = attempts.prepare


@contextmanager
def _at_once() -> Iterator[None]:
    """Withdraw an attempt whose process has not begun when the scheduler looks for the second time."""
    with patch.object(scheduler, "BEGINS_WITHIN_S", 0.0):
        yield


def _locked(path: Path) -> int:
    file = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file
