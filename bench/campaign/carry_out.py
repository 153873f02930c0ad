"""Order of the tasks of a campaign: given to workers, and kept as their results arrive."""

from __future__ import annotations

import asyncio
import concurrent.futures
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any, cast

from bench.campaign import work
from bench.campaign.cluster import KILLS, SchedulerLost, dask_distributed
from bench.campaign.ledger import Ledger
from bench.campaign.program import differences, digest_of, identity
from bench.campaign.progress import Pace, Progress
from bench.campaign.tasks import Campaign, Result, Task
from bench.clock import Stopwatch, wall_utc
from bench.errors import BenchError, InputError

AHEAD = 200  # tasks that the scheduler has beside those that are done
LOOKS_EVERY_S = 2.0
TOGETHER_S = 0.01  # results that follow each other within this are kept together
LOST = "the connection to the scheduler is lost; what has arrived is kept, and the same command goes on"

_CANCELLED = (asyncio.CancelledError, concurrent.futures.CancelledError)

Watch = Callable[[Progress], object]


def carry_out(campaign: Campaign, ledger: Ledger, client: Any, watch: Watch, twice: int = 0) -> None:
    """Do all tasks that are not finished; each that fails once, and each `twice`-th two times (0 for none).

    `watch` is called every few seconds. Raises InputError if a worker has another program or cannot run this one,
    SchedulerLost, and StoreError; results that have arrived are kept in all cases.
    """
    pace, tried = Pace(), set[str]()
    while True:
        tasks = campaign.tasks(ledger.known)
        left = [task for task in tasks if task.digest not in tried and not ledger.is_finished(task)]
        if not left:
            watch(pace.progress(tasks, ledger.known, len(workers_of(client))))
            return
        tried |= {task.digest for task in left}
        again = [task for task in left if twice and int(task.digest[:8], 16) % twice == 0]
        given = _Given(client, campaign.name, [*left, *again])
        shown = Stopwatch()
        try:
            watch(pace.progress(tasks, ledger.known, len(workers_of(client))))
            for results in given.results():
                ledger.add(results)
                for result in results:
                    pace.add(result.took_s)
                if shown.elapsed_s() >= LOOKS_EVERY_S:
                    watch(pace.progress(tasks, ledger.known, len(workers_of(client))))
                    shown = Stopwatch()
        finally:
            given.withdraw()


class _Given:
    """Tasks of a round in the hands of a scheduler, under names that no other campaign there has."""

    def __init__(self, client: Any, name: str, tasks: Sequence[Task]) -> None:
        self._client, self._tasks = client, tasks
        self._name = f"{name}-{uuid.uuid4().hex}"
        self._program = digest_of(identity())
        self._next = 0
        self._out: dict[Any, tuple[Any, Task]] = {}  # by key: future and task
        self._done: SimpleQueue[Any] = SimpleQueue()
        self._problem: BenchError | None = None

    def results(self) -> Iterator[list[Result]]:
        """Yield results that have arrived together; none after some seconds without."""
        with _losses():
            ahead = AHEAD + 2 * sum(each["nthreads"] for each in workers_of(self._client).values())
            self._give(ahead)
            while self._out:
                done = self._arrived()
                yield self._kept(done)
                if self._problem is not None:
                    raise self._problem
                if len(self._out) <= ahead - AHEAD // 4:  # not one by one, which takes longer
                    self._give(ahead - len(self._out))

    def withdraw(self) -> None:
        """Let the scheduler forget what is not done."""
        if self._out and self._client.status == "running":
            with suppress(OSError, *_CANCELLED):  # the scheduler may end meanwhile
                self._client.cancel([future for future, _ in self._out.values()], force=True)
        self._out.clear()

    def _give(self, count: int) -> None:
        some = self._tasks[self._next : self._next + count]
        if not some:
            return
        keys = [(self._name, self._next + number) for number in range(len(some))]
        self._next += len(some)
        columns = zip(*((task.key, task.digest, task.does, dict(task.arguments)) for task in some), strict=True)
        futures = self._client.map(work.do, *columns, key=keys, program=self._program, pure=False)
        for future, task in zip(futures, some, strict=True):
            self._out[future.key] = future, task
            future.add_done_callback(self._done.put)

    def _arrived(self) -> list[Any]:
        """Futures that are done, at least one unless some seconds pass."""
        try:
            found = [self._done.get(timeout=LOOKS_EVERY_S)]
        except Empty:
            if self._client.status != "running":
                raise SchedulerLost(LOST) from None
            return []
        with suppress(Empty):
            while len(found) < AHEAD // 4:
                found.append(self._done.get(timeout=TOGETHER_S))
        return found

    def _kept(self, futures: Sequence[Any]) -> list[Result]:
        """Return the results of futures; a problem of others is raised when these are kept."""
        try:
            found = list(self._client.gather(list(futures)))
        except (Exception, *_CANCELLED):  # noqa: BLE001  which of them it was is seen one by one
            found = []
            for future in futures:
                try:
                    found.append(self._result(future))
                except BenchError as problem:
                    self._problem = problem
        for future in futures:
            del self._out[future.key]
        return found

    def _result(self, future: Any) -> Result:
        """Return the result of a future. Raises InputError if a worker cannot run the program, and SchedulerLost."""
        task = self._out[future.key][1]
        try:
            return cast(Result, future.result())
        except _CANCELLED:
            raise SchedulerLost(LOST) from None
        except work.OtherProgram as problem:
            found = "; ".join(differences(identity(), problem.found))
            raise InputError(
                f"another program on a worker: {problem.host} has {found}. Install the same on all computers"
            ) from None
        except dask_distributed().KilledWorker:
            return self._killer(task)
        except Exception as problem:  # noqa: BLE001  `do` raises nothing else: it could not be called
            text = " ".join(f"{type(problem).__name__}: {problem}".split())[:500]
            raise InputError(f"a worker cannot run the program: {text}. Install the same on all computers") from None

    def _killer(self, task: Task) -> Result:
        problem = f"{KILLS} workers were killed while they did it, by itself or for want of memory"
        at = wall_utc().isoformat(timespec="seconds")
        return Result(task.key, task.digest, self._program, None, problem, 0.0, at, "")


def workers_of(client: Any) -> Mapping[str, Any]:
    """Return what a scheduler knows of its workers, by address. Raises SchedulerLost."""
    with _losses():
        if client.status != "running":
            raise SchedulerLost(LOST)
        workers: Mapping[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
        return workers


@contextmanager
def _losses() -> Iterator[None]:
    """Raise SchedulerLost for a broken connection to the scheduler."""
    try:
        yield
    except (OSError, TimeoutError):  # among them those of dask.distributed
        raise SchedulerLost(LOST) from None
