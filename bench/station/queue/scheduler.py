"""Begin and end of items: one run at a time at each bench, whatever happens to the station."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path

from bench.clock import Stopwatch, wall_utc
from bench.config.models import BenchFile
from bench.errors import BenchError, InputError, StoreError, error_message
from bench.runner.held import owners, real_addresses, why_locked_out
from bench.station.part import Part
from bench.station.queue import attempts
from bench.station.queue.attempts import Attempt, Launcher
from bench.station.queue.items import OCCUPYING, Item, ItemState
from bench.station.queue.schedule import next_item
from bench.station.queue.table import Queue
from bench.station.runs.catalogue import Catalogue
from bench.station.settings import Settings
from bench.store.latch import latch
from bench.store.runs import RunSummary

ITEMS = "items"  # subfolder of attempts
BEGINS_WITHIN_S = 30.0  # a process, counted from when it was started or this station was
ATTEMPTS = 3
LOST = "its process died before the run began; nothing was energised"
WAITING_QUEUED = frozenset({ItemState.QUEUED})


class Scheduler(Part):
    """Begins the next item of each bench, and finds out how items end. Works in the running event loop.

    After a run that did not end by itself with everything safe, or not at all, the bench waits for a person:
    `Queue.go_on`.
    """

    def __init__(self, settings: Settings, queue: Queue, catalogue: Catalogue, launch: Launcher) -> None:
        super().__init__()
        self._settings, self._queue, self._catalogue, self._launch = settings, queue, catalogue, launch
        self._looked: dict[Path, Stopwatch] = {}
        self._benches: dict[str, tuple[int, BenchFile]] = {}

    async def look(self) -> None:
        """Update the items that occupy a bench, then begin items at free benches. Raises StoreError."""
        for item in self._queue.occupying():
            await self._update(item)
        busy = {item.submission.bench for item in self._queue.occupying()}
        for bench in self._settings.benches:
            if bench not in busy:
                await self._begin_next(bench)

    def folder(self, item: Item) -> Path:
        """Return the folder of the last attempt of an item."""
        return self._settings.folder / ITEMS / item.id / str(item.attempts)

    async def _update(self, item: Item) -> None:
        attempt = await asyncio.to_thread(attempts.look, self.folder(item))
        run = await asyncio.to_thread(self._run_of, item)
        if run is not None and not item.run:
            item = self._queue.change(item.id, OCCUPYING, run=run.id, state=ItemState.RUNNING)
        if attempt.lives:
            return
        if run is not None:
            # An interrupted run may be resumed by hand, and then has a process again.
            if run.state != "running":
                self._ended(item, run)
        elif item.run:
            self._missing(item)
        elif attempt.has_begun:
            self._refused(item, attempt)
        elif self._looked.setdefault(self.folder(item), Stopwatch()).elapsed_s() > BEGINS_WITHIN_S:
            self._again(item)

    def _run_of(self, item: Item) -> RunSummary | None:
        """Return the run of an item; it is searched for by its ticket until it is known."""
        if not item.run:
            return self._catalogue.of_ticket(item.id, item.begun_at or item.submitted_at)
        with suppress(InputError):
            return self._catalogue.run(item.run)
        return None

    def _again(self, item: Item) -> None:
        """Queue an item again whose process has not begun; after some attempts, hold it."""
        if not attempts.withdraw(self.folder(item)):
            return  # it has begun just now
        if item.attempts < ATTEMPTS:
            self._queue.change(item.id, OCCUPYING, state=ItemState.QUEUED, reason="")
        else:
            reason = f"its process was started {item.attempts} times and did not begin; nothing was energised"
            self._queue.change(item.id, OCCUPYING, state=ItemState.HELD, reason=reason)

    def _ended(self, item: Item, run: RunSummary) -> None:
        latched = latch(run)
        self._queue.change(
            item.id, OCCUPYING, state=ItemState.ENDED, outcome=run.state, verdict=run.manifest.get("verdict"),
            ended_at=wall_utc(), reason=latched.why if latched is not None else "",
        )  # fmt: skip
        if latched is not None or run.state in ("interrupted", "damaged"):
            why = latched.why if latched is not None else f"the run is {run.state}"
            self._queue.stop(item.submission.bench, f"{run.id}: {why}")

    def _missing(self, item: Item) -> None:
        """End an item whose run directory was moved away, or is not part of a restored backup."""
        reason = f"{item.run}: the directory of this run is not in {self._settings.runs}"
        self._queue.change(
            item.id, OCCUPYING, state=ItemState.ENDED, outcome="missing", ended_at=wall_utc(), reason=reason
        )
        self._queue.stop(item.submission.bench, reason)

    def _refused(self, item: Item, attempt: Attempt) -> None:
        self._queue.change(
            item.id, OCCUPYING, state=ItemState.REFUSED, ended_at=wall_utc(), reason=attempt.messages or LOST
        )

    async def _begin_next(self, bench: str) -> None:
        item = next_item(self._queue.waiting(bench), wall_utc())
        if item is None or self._queue.stopped(bench):
            return
        reason = await asyncio.to_thread(self._why_not, bench)
        if reason:
            if reason != item.reason:
                self._queue.change(item.id, WAITING_QUEUED, reason=reason)
            return
        await self._begin(item)

    async def _begin(self, item: Item) -> None:
        item = self._queue.change(
            item.id, WAITING_QUEUED, state=ItemState.STARTING, attempts=item.attempts + 1, begun_at=wall_utc(),
            reason="",
        )  # fmt: skip
        try:
            folder = self.folder(item)
            await asyncio.to_thread(attempts.prepare, folder, self.words(item), self._settings.folder)
            await asyncio.to_thread(self._launch, folder)
        except StoreError as problem:
            self._queue.change(item.id, OCCUPYING, state=ItemState.HELD, reason=str(problem))

    def words(self, item: Item) -> list[str]:
        """Return the words of `bench run` for an item, with all paths absolute."""
        wanted, settings = item.submission, self._settings
        files = {"--bench": settings.bench_file(wanted.bench), "--runs": settings.runs, "--ticket": item.id}
        if item.inputs:
            files["--inputs"] = item.inputs
        options = [f"{name}={value}" for name, value in files.items()]
        options += [f"--alert-route={each}" for each in settings.alert_routes]
        return ["run", str(settings.sequence_file(wanted.sequence)), *options, *wanted.options()]

    def _why_not(self, name: str) -> str:
        """Return why no run can begin at a bench now; "" if one can."""
        try:
            bench = self.bench(name)
            if why := why_locked_out(bench):
                return f"the bench is {why}"
            found = owners(real_addresses(bench).values())
        except BenchError as problem:
            return error_message(problem)
        return f"waits for {', '.join(sorted(map(str, found)))}" if found else ""

    def bench(self, name: str) -> BenchFile:
        """Return a bench file, read again when it has changed. Raises InputError."""
        try:
            mark = self._settings.bench_file(name).stat().st_mtime_ns
        except OSError as problem:
            raise InputError(f"bench {name}: its file cannot be read ({problem})") from problem
        if name not in self._benches or self._benches[name][0] != mark:
            self._benches[name] = mark, self._settings.bench(name).bench
        return self._benches[name][1]
