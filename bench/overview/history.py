"""History of benches and units from an archive of runs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import Any, NamedTuple, TypeVar

from bench.clock import Stopwatch
from bench.errors import BenchError

FRESH_S = 60.0  # for which an answer is given again
ANSWERS_WITHIN_S = 20.0
KEPT = 200
MOST_RUNS = 20
MOST_ASKED = 8  # at once; a store that hangs keeps the first of them
Answer = TypeVar("Answer")
_RUNS = """
SELECT run, title, units, state, verdict, started, ended, sequence, station FROM runs
WHERE list_contains(?, bench) ORDER BY station = ? DESC, started DESC LIMIT ?
"""


class PastRun(NamedTuple):
    """Run in an archive."""

    run: str
    title: str
    units: tuple[str, ...]
    state: str
    verdict: str
    started: datetime | None


class History:
    """Archive of runs, asked by one thread, so that a slow one holds up nothing else."""

    def __init__(self, url: str) -> None:
        from bench.archive.query import opened  # its libraries are an extra

        self.url, self._open = url, opened
        self._thread = ThreadPoolExecutor(1, "archive")
        self._asking = 0
        self._answers: dict[tuple[object, ...], tuple[Stopwatch, Any]] = {}

    def close(self) -> None:
        """Ask nothing more; a question that is being answered is left alone."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def runs_of(self, benches: tuple[str, ...], computer: str) -> list[PastRun]:
        """Return the last runs of a bench by its titles in records. Raises BenchError.

        If any were published by its `computer`, only these: other stations may have benches with the same title.
        """

        def ask() -> list[PastRun]:
            rows = self._open(self.url).query(_RUNS, [list(benches), computer, MOST_RUNS]).records()
            own = [row for row in rows if row["station"] == computer]
            return [_past(row) for row in own or rows]

        return await self._asked(("runs", benches, computer), ask)

    async def unit(self, serial: str) -> Any:
        """Return the history of a unit. Raises BenchError, InputError if the archive has no results of it."""

        def ask() -> Any:
            from bench.archive.units import unit_history

            return unit_history(self._open(self.url), serial)

        return await self._asked(("unit", serial), ask)

    async def _asked(self, key: tuple[object, ...], ask: Callable[[], Answer]) -> Answer:
        """Return an answer, or that of a minute ago."""
        known = self._answers.get(key)
        if known is not None and known[0].elapsed_s() < FRESH_S:
            found: Answer = known[1]
            return found
        if self._asking >= MOST_ASKED:
            raise BenchError("the archive answers another question; try again in a moment")
        self._asking += 1
        asking = asyncio.get_running_loop().run_in_executor(self._thread, ask)
        asking.add_done_callback(self._answered)
        try:
            async with asyncio.timeout(ANSWERS_WITHIN_S):
                found = await asyncio.shield(asking)
        except TimeoutError:
            raise BenchError(f"the archive {self.url} does not answer within {ANSWERS_WITHIN_S:g} s") from None
        while len(self._answers) >= KEPT:
            self._answers.pop(next(iter(self._answers)))
        self._answers[key] = Stopwatch(), found
        return found

    def _answered(self, done: asyncio.Future[Any]) -> None:
        self._asking -= 1
        if not done.cancelled():
            done.exception()  # has been raised, or comes after its question was given up


def _past(row: dict[str, Any]) -> PastRun:
    units = tuple(each.strip() for each in str(row["units"] or "").split(",") if each.strip())
    return PastRun(
        str(row["run"]), str(row["title"] or row["sequence"] or ""), units, str(row["state"] or ""),
        str(row["verdict"] or ""), row["started"],
    )  # fmt: skip
