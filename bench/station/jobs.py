"""Jobs of a station that take minutes: rehearsals, reports and reductions, one after the other, in a worker process."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.clock import wall_utc
from bench.errors import BenchError, InputError
from bench.station.part import Part
from bench.station.worker import Workers

LIMIT_S = 1800.0
WAITING_MOST, KEPT = 20, 100


class JobState(StrEnum):
    """State of a job; the last two are final."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class Job(BaseModel):
    """Job with its result, or with the problem that ended it."""

    model_config = ConfigDict(frozen=True)

    id: str
    what: str = Field(description="rehearsal, reduction or report")
    of: str = Field(description="sequence or run")
    by: str
    state: JobState = JobState.WAITING
    asked_at: datetime
    began_at: datetime | None = None
    ended_at: datetime | None = None
    result: Any = None
    problem: str = ""

    @property
    def is_over(self) -> bool:
        """True if it has ended."""
        return self.state in (JobState.DONE, JobState.FAILED)


class Jobs(Part):
    """Jobs in the order in which they were asked for. They are not kept when the station ends."""

    def __init__(self) -> None:
        super().__init__()
        self._workers = Workers(limit_s=LIMIT_S)
        self._jobs: dict[str, Job] = {}
        self._waiting: asyncio.Queue[tuple[str, Callable[..., Any], tuple[Any, ...]]] = asyncio.Queue(WAITING_MOST)

    async def look(self) -> None:
        """Do the jobs that wait."""
        while not self._waiting.empty():
            await self._do(*self._waiting.get_nowait())
            self._waiting.task_done()

    def close(self) -> None:
        """End the worker process."""
        self._workers.close()

    def ask(self, id_: str, what: str, of: str, by: str, work: Callable[..., Any], *args: Any) -> Job:
        """Ask for a job; one with the same id that has not ended is returned instead.

        `work` is a function of a module, and its result is plain JSON content. Raises InputError if too many wait.
        """
        if (known := self._jobs.get(id_)) is not None and not known.is_over:
            return known
        try:
            self._waiting.put_nowait((id_, work, args))
        except asyncio.QueueFull:
            raise InputError(f"{WAITING_MOST} jobs wait already; try again when some have ended") from None
        self._jobs.pop(id_, None)
        job = self._jobs[id_] = Job(id=id_, what=what, of=of, by=by, asked_at=wall_utc())
        for old in [each.id for each in self._jobs.values() if each.is_over][:-KEPT]:
            del self._jobs[old]
        self.wake()
        return job

    async def finished(self) -> None:
        """Wait until no job waits or runs."""
        await self._waiting.join()

    def job(self, id_: str) -> Job:
        """Return a job. Raises InputError."""
        if (found := self._jobs.get(id_)) is None:
            raise InputError("there is no such job; the station forgets jobs when it starts again")
        return found

    def find(self, id_: str) -> Job | None:
        """Return a job, or None if it was not asked for."""
        return self._jobs.get(id_)

    async def _do(self, id_: str, work: Callable[..., Any], args: tuple[Any, ...]) -> None:
        self._change(id_, state=JobState.RUNNING, began_at=wall_utc())
        try:
            result = await self._workers.call(work, *args)
        except BenchError as problem:
            self._change(id_, state=JobState.FAILED, problem=str(problem), ended_at=wall_utc())
        except Exception as problem:  # noqa: BLE001  an error in one job must not end the station
            self._change(
                id_, state=JobState.FAILED, problem=f"{type(problem).__name__}: {problem}", ended_at=wall_utc()
            )
        else:
            self._change(id_, state=JobState.DONE, result=result, ended_at=wall_utc())

    def _change(self, id_: str, **changes: Any) -> None:
        self._jobs[id_] = self._jobs[id_].model_copy(update=changes)
