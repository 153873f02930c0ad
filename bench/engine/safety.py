"""What runs to its end even when the task around it is cancelled."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def finish(work: Coroutine[Any, Any, T], limit_s: float) -> T:
    """Runs `work` to its end, at most `limit_s`, however often the caller is cancelled; then the cancellation goes on.

    Raises TimeoutError when the limit passes.
    """
    task = asyncio.create_task(_limited(work, limit_s))
    if (cancelled := await outlast(task)) is not None:
        task.exception()  # seen; the cancellation is what the caller hears of
        raise cancelled
    return task.result()


async def outlast(task: asyncio.Task[Any]) -> asyncio.CancelledError | None:
    """Waits for a task to end, however often the caller is cancelled; the last cancellation, which is to be raised."""
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as request:
            cancelled = request
    return cancelled


async def _limited(work: Coroutine[Any, Any, T], limit_s: float) -> T:
    async with asyncio.timeout(limit_s):
        return await work
