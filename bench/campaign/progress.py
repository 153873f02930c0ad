"""Progress of a campaign, and the time at which it is likely to end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from statistics import fmean

from bench.campaign.tasks import Known, Task
from bench.clock import Stopwatch, wall_utc


@dataclass(frozen=True)
class Progress:
    """State of a campaign: finished and failed of all tasks, workers that are there, and when it ends; None if unknown.

    `ends` is an instant in UTC.
    """

    finished: int
    failed: int
    tasks: int
    workers: int
    ends: datetime | None

    def in_words(self) -> str:
        """One line, with times by the clock of this computer."""
        failed = f", {self.failed} failed" if self.failed else ""
        workers = f"{self.workers} workers" if self.workers else "no worker: waiting for one"
        line = f"{_clock(wall_utc())} {self.finished} of {self.tasks} done{failed}, {workers}"
        return f"{line}, end about {_clock(self.ends)}" if self.ends is not None else line


class Pace:
    """Pace of this session: seconds of work that all workers together do in a second."""

    def __init__(self) -> None:
        self._watch = Stopwatch()
        self._done_s = 0.0
        self._last_s = 0.0  # of this session, when the last result arrived

    def add(self, took_s: float) -> None:
        """Count a result of this session."""
        self._done_s += took_s
        self._last_s = self._watch.elapsed_s()

    def progress(self, tasks: Iterable[Task], known: Known, workers: int) -> Progress:
        """State of a campaign with these tasks; each is expected to take as long as the others of its sort."""
        finished, failed, left = 0, 0, list[Task]()
        took_s = defaultdict[str, list[float]](list)
        for task in tasks:
            result = known(task)
            if result is None:
                left.append(task)
                continue
            finished += result.is_finished
            failed += not result.is_finished
            took_s[task.sort].append(result.took_s)
        return Progress(finished, failed, finished + failed + len(left), workers, self._ends(left, took_s))

    def _ends(self, left: list[Task], took_s: dict[str, list[float]]) -> datetime | None:
        """Return when the tasks that are left end at the pace up to the last result; those under way are among them."""
        if not left or not self._done_s or not self._last_s:
            return None
        means_s = {sort: fmean(each) for sort, each in took_s.items()}
        usual_s = fmean(means_s.values())
        left_s = sum(means_s.get(task.sort, usual_s) for task in left)
        since_s = self._watch.elapsed_s() - self._last_s
        return wall_utc() + timedelta(seconds=max(0.0, left_s * self._last_s / self._done_s - since_s))


def _clock(at: datetime) -> str:
    """Time by the clock of this computer, with the day if it is another one."""
    local = at.astimezone()
    is_today = local.date() == wall_utc().astimezone().date()
    return f"{local:%H:%M}" if is_today else f"{local:%Y-%m-%d %H:%M}"
