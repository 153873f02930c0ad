"""Live view of running runs: what pages, MQTT and alerts show. The record of a run is the truth; this may be late."""

from __future__ import annotations

import asyncio
import json
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from bench.clock import wall_utc
from bench.engine.state import RunState, advanced
from bench.errors import BenchError, InputError, StoreError
from bench.runner.tell import send_command
from bench.station.part import Part
from bench.station.prepare.plans import timeline_of_run
from bench.station.runs.catalogue import Catalogue, request_of
from bench.station.runs.remaining import Course, earlier_courses, left_by_courses, left_by_plan
from bench.station.worker import Workers
from bench.store.reader import Event
from bench.store.runs import RunSummary
from bench.store.tail import Begins, Tail, instant_at

EVENTS_KEPT = 200
NO_TIMELINE: Mapping[str, Any] = {"steps": [], "total_s": 0.0}


class Ending(NamedTuple):
    """Estimated wall time of the end of a run, with its bounds.

    These are by `runs` earlier runs of the same plan; without any, by the limits of soaks and waits.
    """

    ends: datetime
    least: datetime
    most: datetime
    runs: int


class LiveRun:
    """View of one run. `events` are the newest entries of its journal, `status` the last answer of its process.

    `begun` are the instant of the begin by the clock of the bench, and its bench time in s; None until they are read.
    `earlier` are the courses of earlier runs of the same plan.
    """

    def __init__(self, run: RunSummary) -> None:
        self.run = run
        self.state = RunState()
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.status: Mapping[str, Any] = {}
        self.timeline: Mapping[str, Any] | None = None
        self.earlier: Sequence[Course] = ()
        self.begun: Begins = None
        self._seen: tuple[datetime, float] | None = None  # first look: wall time and bench time
        self._now: tuple[datetime, float] | None = None

    @property
    def last(self) -> int:
        """Number of the last entry of the journal that was read."""
        return self.events[-1].seq if self.events else 0

    def look(self) -> list[Event]:
        """Read what has been added; return the new entries. Blocks for the disk and the run's answer."""
        new: list[Event] = []
        with suppress(StoreError), Tail(self.run.path) as tail:  # a run that has just begun has no database
            new = tail.events(self.last)
        for event in new:
            self.state = advanced(self.state, event.kind, event.step, event.data)
            if event.kind == "run_begins":
                self.begun = datetime.fromisoformat(event.data["utc"]), event.at_s
            self.events.append(event)
        with suppress(BenchError, ValueError):
            self.status = json.loads(send_command(self.run.path, "status"))
            now_s = float(self.status["now_s"])
            self._now = wall_utc(), now_s
            self._seen = self._seen or self._now
        return new

    @property
    def holds(self) -> list[str]:
        """Why no further step begins, also while one is still completed."""
        return [str(each) for each in self.status.get("holds", sorted(self.state.held))]

    @property
    def speed(self) -> float:
        """Bench seconds per second since the first look; at first what was asked for, or 1."""
        if self._seen is None or self._now is None:
            return self._asked_speed()
        wall_s = (self._now[0] - self._seen[0]).total_seconds()
        bench_s = self._now[1] - self._seen[1]
        return bench_s / wall_s if wall_s > 5.0 and bench_s > 0 else self._asked_speed()

    def _asked_speed(self) -> float:
        try:
            return float(request_of(self.run.manifest)["speed"])
        except (KeyError, TypeError, ValueError):
            return 1.0  # not asked for, or as fast as possible

    def instant_of(self, event: Event) -> datetime | None:
        """Return the instant of an entry by the clock of the bench; None until that is known."""
        return instant_at(self.begun, event.at_s)

    def ends(self) -> datetime | None:
        """Return the estimated wall time of the end."""
        found = self.ending()
        return found.ends if found is not None else None

    def ending(self) -> Ending | None:
        """Return the estimated wall time of the end and its bounds.

        None while the plan is not known, and for manual control, which ends when a person ends it.
        """
        if not self.timeline or self._now is None or self.begun is None or self.status.get("manual"):
            return None
        steps = self.timeline["steps"]
        if not steps:
            return Ending(wall_utc(), wall_utc(), wall_utc(), 0)
        begins = [float(step["begin_s"]) for step in steps]
        now_s = self._now[1] - self.begun[1]
        at = next((n for n, step in enumerate(steps) if step["id"] in self.state.under_way), None)
        if at is None:
            at, in_step_s = max(0, bisect_right(begins, now_s) - 1), 0.0
        else:
            begun_s = next((e.at_s for e in reversed(self.events) if e.step == steps[at]["id"]), self._now[1])
            in_step_s = self._now[1] - begun_s
        left = left_by_courses(self.earlier, steps[at]["id"], in_step_s) or left_by_plan(
            steps, float(self.timeline["total_s"]), at, in_step_s
        )
        ends, least, most = (wall_utc() + timedelta(seconds=each / self.speed) for each in left[:3])
        return Ending(ends, least, most, left.runs)


class Live(Part):
    """Views of all running runs. `running` returns these runs; `on_event` receives each new entry of a journal."""

    def __init__(self, running: Callable[[], list[RunSummary]]) -> None:
        super().__init__()
        self._running = running
        self.runs: dict[str, LiveRun] = {}
        self.on_event: list[Callable[[LiveRun, Event], object]] = []

    async def look(self) -> None:
        """Look at all running runs once; a run that has ended is looked at for the last time."""
        found = {run.id: run for run in await asyncio.to_thread(self._running)}
        for name, run in found.items():
            live = self.runs.setdefault(name, LiveRun(run))
            live.run = run  # the manifest of a run that has just begun is not written yet
        for name, live in list(self.runs.items()):
            for event in await asyncio.to_thread(live.look):
                for call in self.on_event:
                    call(live, event)
            if name not in found:
                del self.runs[name]


class Timelines(Part):
    """Timelines of running runs, which a worker process makes in a second or two."""

    every_s = 1.0
    stuck_after_s = 600.0  # a worker has a minute for each of them

    def __init__(self, live: Live, workers: Workers, catalogue: Catalogue) -> None:
        super().__init__()
        self._live, self._workers, self._catalogue = live, workers, catalogue

    async def look(self) -> None:
        """Make the timelines that are missing, and look for earlier runs of the same plan."""
        for live in [each for each in self._live.runs.values() if each.timeline is None]:
            try:
                live.timeline = await self._workers.call(timeline_of_run, live.run.path) or NO_TIMELINE
            except InputError:
                live.timeline = NO_TIMELINE
                raise
            live.earlier = await asyncio.to_thread(earlier_courses, self._catalogue, live.run)
