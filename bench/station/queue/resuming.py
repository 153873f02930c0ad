"""Resumption of interrupted runs: as `bench resume`, in a process that outlives the station."""

from __future__ import annotations

import asyncio
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from bench.clock import wall_utc
from bench.errors import BenchError, InputError, InUseError
from bench.station.queue import attempts
from bench.station.queue.attempts import Launcher
from bench.station.queue.table import Queue
from bench.station.runs.catalogue import bench_file_of
from bench.station.settings import Settings
from bench.store.runs import RunSummary

RESUMPTIONS = "resumptions"
BEGINS_WITHIN_S = 30.0  # a process


class ResumptionView(BaseModel):
    """Resumption of a run: what it would do, or why it is not possible; `messages` are those of the last attempt."""

    model_config = ConfigDict(frozen=True)

    possible: bool
    lines: list[str] = Field(description="what is done again and restored, or the problems")
    messages: str = ""
    under_way: bool = False


def resumption_of(path: Path) -> tuple[bool, list[str]]:
    """Return if a run can be resumed, and what that would do or why not. For a worker process."""
    from bench.app.resume import prepare_again, read_interrupted, summary_lines

    try:
        resumption = read_interrupted(path)
        return True, list(summary_lines(resumption, prepare_again(resumption)))
    except BenchError as problem:
        return False, list(problem.problems) if isinstance(problem, InputError) else [str(problem)]


class Resuming:
    """Processes that resume runs, one for each run at a time."""

    def __init__(self, settings: Settings, queue: Queue, launch: Launcher) -> None:
        self._settings, self._queue, self._launch = settings, queue, launch

    def last(self, run: RunSummary) -> attempts.Attempt | None:
        """Return the last attempt to resume a run, or None."""
        made = self._made(run)
        return attempts.look(made[-1]) if made else None

    def is_under_way(self, run: RunSummary) -> bool:
        """Return True if the last attempt lives, or may still begin; one that has not begun in time never will."""
        made = self._made(run)
        if not made:
            return False
        found = attempts.look(made[-1])
        if found.lives or found.has_begun:
            return found.lives
        age_s = wall_utc().timestamp() - made[-1].stat().st_mtime
        return age_s < BEGINS_WITHIN_S or (not attempts.withdraw(made[-1]) and attempts.look(made[-1]).lives)

    async def resume(self, run: RunSummary) -> None:
        """Start the process that resumes a run. Raises InUseError if one is under way, or its bench has an item."""
        if await asyncio.to_thread(self.is_under_way, run):
            raise InUseError(f"{run.id} is being resumed already")
        bench = self._settings.bench_of(bench_file_of(run.manifest))
        others = [each for each in self._queue.occupying() if each.run != run.id]
        if any(item.submission.bench == bench for item in others):
            raise InUseError(f"bench {bench} has another run; resume {run.id} when that has ended")
        folder = self._folder(run) / f"{len(self._made(run)) + 1:04d}"
        words = ["resume", str(run.path), "--interrupted"]
        await asyncio.to_thread(attempts.prepare, folder, words, self._settings.folder)
        await asyncio.to_thread(self._launch, folder)

    def _folder(self, run: RunSummary) -> Path:
        return self._settings.folder / RESUMPTIONS / run.id

    def _made(self, run: RunSummary) -> list[Path]:
        folder = self._folder(run)
        return sorted(folder.iterdir()) if folder.is_dir() else []
