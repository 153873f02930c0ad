"""Work ahead of the first look: a worker process compiles templates and reads sequences and results before a page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from typing import ParamSpec, TypeVar

from bench.clock import Stopwatch
from bench.errors import InputError
from bench.figures.templates import compiled
from bench.station.daemon import Daemon
from bench.station.part import Part
from bench.station.prepare.before_a_run import imported
from bench.station.prepare.sequences import views_of
from bench.station.units.history import history
from bench.web.pages.render import COMPILED, TEMPLATES_OF

AFTER_S = 1.0  # the queue, and a test that needs a station for a moment, come first
NEWEST = 50  # runs whose units are prepared at the start of a station
P = ParamSpec("P")
T = TypeVar("T")


class Ahead(Part):
    """Keeps ready what pages need: templates, sequences and histories of units; at the start, then what changes.

    What is not ready yet is made when it is asked for: an error here costs time and nothing else.
    """

    stuck_after_s = 600.0  # a worker has a minute for each of them

    def __init__(self, daemon: Daemon) -> None:
        super().__init__()
        self._daemon, self._began = daemon, Stopwatch()
        self._runs: set[str] = set()  # whose end is awaited
        self._started = False
        daemon.live.on_event.append(lambda live, _: self._runs.add(live.run.id))

    async def look(self) -> None:
        """Read the sequences that have changed, and make the histories of the units whose runs have ended."""
        if self._began.elapsed_s() < AFTER_S:
            return
        self.every_s = 2.0
        ended = self._runs - self._daemon.live.runs.keys()
        if not self._started:
            COMPILED.kept |= await self._done(compiled, TEMPLATES_OF) or {}
        await self._sequences()
        if not self._started:
            await self._done(imported)
            ended |= set(await asyncio.to_thread(lambda: list(islice(self._daemon.catalogue.names(), NEWEST))))
            self._started = True
        self._runs -= ended
        for serial in await asyncio.to_thread(self._units, ended):
            await self._history(serial)

    async def _done(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return the result of a worker; None where it has failed."""
        with suppress(InputError):
            return await self._daemon.workers.call(work, *args, **kwargs)
        return None

    async def _sequences(self) -> None:
        sequences = self._daemon.sequences
        changed = await asyncio.to_thread(sequences.changed)
        if changed and (views := await self._done(views_of, {path: sequences.is_own(path) for path in changed})):
            for (path, mark), view in zip(changed.items(), views, strict=True):
                sequences.keep(path, mark, view)

    def _units(self, runs: set[str]) -> list[str]:
        """Return the units of runs that are there, those of the newest first."""
        found: dict[str, None] = {}
        for name in sorted(runs, reverse=True):
            with suppress(InputError):
                found |= dict.fromkeys(self._daemon.catalogue.run(name).units)
        return list(found)

    async def _history(self, serial: str) -> None:
        histories = self._daemon.histories
        runs = await asyncio.to_thread(histories.runs_of, serial)
        if histories.lacks(serial, runs) and (found := await self._done(history, serial, runs)) is not None:
            histories.keep(serial, runs, found)
