"""Work in processes of its own: checks take seconds of processor time, and the files are what users wrote."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from typing import NamedTuple, ParamSpec, TypeVar

from bench.app.request import RunRequest
from bench.errors import InputError

LIMIT_S = 60.0

P = ParamSpec("P")
T = TypeVar("T")


class Checked(NamedTuple):
    """Result of a check: expected duration in s of bench time, warnings, and the problems that forbid a run.

    `inputs` are the texts of the input files by the names of their copies.
    """

    expected_s: float = 0.0
    warnings: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    inputs: Mapping[str, str] = {}


def check(request: RunRequest) -> Checked:
    """Check a request as `bench check` does."""
    from bench.app.inputs import inputs_of
    from bench.app.request import prepare
    from bench.sequence.checks.output import warning_line

    try:
        prepared = prepare(request)
    except InputError as problem:
        return Checked(problems=problem.problems)
    lines = tuple(warning_line(each, prepared.plan.document) for each in prepared.warnings)
    if request.unattended and not prepared.loaded.bench.is_simulated:
        from bench.app.preflight import alert_line

        line = alert_line(prepared)
        # The program of a bench file can still be tried before the run begins, which looks again.
        if line.state == "NO" and prepared.loaded.bench.alert is None:
            return Checked(prepared.expected.total_s, lines, (f"nobody would learn how the run ends: {line.text}",))
        lines = (*lines, f"alert: {line.text}")
    return Checked(prepared.expected.total_s, lines, inputs=inputs_of(prepared))


def _end_with_parent() -> None:
    """End this process when that of the station dies, even if it is killed."""

    def wait() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()


def _name(work: Callable[..., object]) -> str:
    return f"the {work.__name__.replace('_', ' ')}"


class Workers:
    """Worker processes, started when they are first needed."""

    def __init__(self, count: int = 1, limit_s: float = LIMIT_S) -> None:
        self._count, self._limit_s = count, limit_s
        self._pool: ProcessPoolExecutor | None = None

    async def call(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Return the result of a module's function, called in a worker; everything passed must be picklable.

        Raises InputError if the work takes longer than the limit of these workers, or ends its process.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(self._count, get_context("spawn"), initializer=_end_with_parent)
        working = asyncio.wrap_future(self._pool.submit(work, *args, **kwargs))
        try:
            async with asyncio.timeout(self._limit_s):
                return await working
        except TimeoutError:
            self.close()
            raise InputError(f"{_name(work)} has not ended within {self._limit_s:g} s") from None
        except asyncio.CancelledError:
            if working.cancelled() and (task := asyncio.current_task()) is not None and not task.cancelling():
                raise InputError(f"{_name(work)} was ended with the process that it waited for; try again") from None
            raise
        except BrokenProcessPool as problem:
            self.close()
            raise InputError(f"the process of {_name(work)} has died ({problem})") from None

    def close(self) -> None:
        """End the processes at once; the next call starts new ones."""
        if self._pool is None:
            return
        pool, self._pool = self._pool, None
        processes = list((pool._processes or {}).values())  # noqa: SLF001  the pool has no way to kill them
        for each in processes:
            each.kill()
        # A process killed while sending leaves half a message in the pipe of results. Reading it blocks until all write
        # ends of the pipe are closed, and the pool keeps one open.
        pool._result_queue._writer.close()  # type: ignore[attr-defined]  # noqa: SLF001  it has no public name
        pool.shutdown(cancel_futures=True)
