"""Work that is completed even if the task around it is cancelled."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from drivers.timing.awake import fair_timeout

T = TypeVar("T")


def _never() -> bool:
    return False


async def finish(work: Coroutine[Any, Any, T], limit_s: float, unless: Callable[[], bool] = _never) -> T:
    """Complete `work`, within `limit_s`, however often the caller is cancelled; then let the cancellation continue.

    A cancellation while `unless` is true ends the work as well. Raises TimeoutError when the limit passes.
    """
    return await _unless_cancelled(asyncio.create_task(_limited(work, limit_s)), unless)


async def wait_uncancelled(
    task: asyncio.Task[Any], unless: Callable[[], bool] = _never
) -> asyncio.CancelledError | None:
    """Wait for a task to end, however often the caller is cancelled; return the last cancellation, to be raised.

    A cancellation while `unless` is true is passed on to the task.
    """
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as request:
            cancelled = request
            if unless():
                task.cancel()
    return cancelled


async def grouped(work: Coroutine[Any, Any, None]) -> None:
    """Await work that waits for a TaskGroup; raise the first of its errors, but CancelledError if the caller is to end.

    The work gets its own task, because a group that ends by an error loses a cancellation from outside.
    """
    try:
        await _unless_cancelled(asyncio.create_task(work), lambda: True)
    except BaseExceptionGroup as problems:
        raise _first_of(problems) from problems


async def _unless_cancelled(task: asyncio.Task[T], unless: Callable[[], bool]) -> T:
    """Result or exception of an ended task; a cancellation of the caller takes precedence."""
    if (cancelled := await wait_uncancelled(task, unless)) is not None:
        if not task.cancelled():
            task.exception()  # exception retrieved; the caller gets the cancellation
        raise cancelled
    return task.result()


def _first_of(problems: BaseExceptionGroup[BaseException]) -> BaseException:
    problem = problems.exceptions[0]
    return _first_of(problem) if isinstance(problem, BaseExceptionGroup) else problem


async def _limited(work: Coroutine[Any, Any, T], limit_s: float) -> T:
    async with fair_timeout(limit_s):
        return await work
