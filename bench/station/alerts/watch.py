"""Watch over runs, queue and benches: every cause of an alert gets its row, also one of while the station was down."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from typing import NamedTuple

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.alerts import causes
from bench.station.alerts.kinds import Cause
from bench.station.alerts.settings import AlertsEntry
from bench.station.alerts.table import AlertTable
from bench.station.part import Part
from bench.station.queue.items import Item, ItemState
from bench.station.queue.table import Queue
from bench.station.runs.catalogue import Catalogue, bench_file_of
from bench.station.runs.live import Live, LiveRun
from bench.station.settings import Settings
from bench.store.reader import Event
from bench.store.runs import RunSummary

ANSWERED = frozenset({"answered", "unanswered", "step_failed", "step_cut"})


class Watched(NamedTuple):
    """What is watched of a station."""

    settings: Settings
    queue: Queue
    catalogue: Catalogue
    live: Live


class Watch(Part):
    """Watch of a station. It reads journals by way of the live view, and the catalogue for runs that have ended."""

    every_s = 1.0

    def __init__(self, alerts: AlertsEntry, table: AlertTable, watched: Watched) -> None:
        super().__init__()
        self._alerts, self._table = alerts, table
        self._settings, self._queue, self._catalogue, self._live = watched
        self._events: list[tuple[LiveRun, Event]] = []
        self._over: set[str] = set()  # runs that need no further look
        self._before = frozenset(watched.catalogue.names())  # runs older than this process
        self._has_caught_up = False
        self._queue_changed = True
        watched.live.on_event.append(lambda run, event: self._events.append((run, event)))

    def queue_changed(self, _item: Item) -> None:
        """Look at the items of the queue."""
        self._queue_changed = True
        self.wake()

    async def look(self) -> None:
        """Make alerts of all that has happened since the last look, and escalate those that nobody acknowledges."""
        if not self._live.looks:
            return  # which runs are running is not known yet
        stops = self._stops()  # before the ends: the alert of a run says that its bench waits
        self._take_events()
        await self._take_ends()
        now = wall_utc()
        self._table.add([*(each for each in stops if not self._is_told(each)), *self._items()], now)
        self._queue_changed = False
        self._table.escalate(timedelta(seconds=self._alerts.escalate_after), now)

    def _take_events(self) -> None:
        events = list(self._events)
        for live, event in events:
            run = live.run
            cause = causes.of_event(run, event, self._bench(run), historical=self._is_historical(live, event))
            if cause is not None:
                self._table.add([cause], wall_utc())
            elif event.kind in ANSWERED and event.step:
                self._table.answered(run.id, event.step, wall_utc())
        del self._events[: len(events)]  # after they are on the disk

    def _is_historical(self, live: LiveRun, event: Event) -> bool:
        """Return True for an entry that is older than this process, unless it is a question that is still open."""
        return not self._has_caught_up and live.run.id in self._before and event.step not in live.state.questions

    async def _take_ends(self) -> None:
        """Make alerts of runs that have ended; at first of those that have ended while the station was down."""
        running = set(self._live.runs)
        self._over -= running  # one that was interrupted goes on
        oldest = f"{self._table.since():%Y%m%dT%H%M%SZ}"
        names = await asyncio.to_thread(self._catalogue.names)
        for name in names:
            if name >= oldest and name not in running | self._over:
                await self._take_end(name)
        self._has_caught_up = True

    async def _take_end(self, name: str) -> None:
        try:
            run = await asyncio.to_thread(self._catalogue.run, name)
        except InputError:
            return  # its folder was removed
        if run.state == "running":
            return
        if not self._table.is_known(causes.key_of_end(run)):
            has_program = await asyncio.to_thread(self._has_program, self._bench(run))
            historical = not self._has_caught_up and name in self._before
            self._table.answered(run.id, None, wall_utc())
            cause = causes.of_end(run, self._bench(run), has_program=has_program, historical=historical)
            self._table.add([cause], wall_utc())
        self._over.add(name)

    def _stops(self) -> list[Cause]:
        return [
            causes.of_stop(bench, reason, since)
            for bench in self._settings.benches
            for reason, since in [self._queue.stop_of(bench)]
            if reason
        ]

    def _is_told(self, stop: Cause) -> bool:
        """Return True if the alert of a run that did not end well says why its bench is stopped."""
        run, _, _ = stop.values["text"].partition(":")
        return self._table.has_end(run)

    def _items(self) -> list[Cause]:
        if not self._queue_changed:
            return []
        begun = self._table.since()
        items = self._queue.items(ItemState.REFUSED, ItemState.HELD)
        recent = (each for each in items if (each.ended_at or each.begun_at or begun) >= begun)
        return [cause for each in recent if (cause := causes.of_item(each)) is not None]

    def _bench(self, run: RunSummary) -> str:
        return self._settings.bench_of(bench_file_of(run.manifest)) or ""

    def _has_program(self, bench: str) -> bool:
        try:
            return bool(bench) and self._settings.bench(bench).bench.alert is not None
        except InputError:
            return False
