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
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as request:
            cancelled = request
    if cancelled is not None:
        task.exception()  # seen; the cancellation is what the caller hears of
        raise cancelled
    return task.result()


async def _limited(work: Coroutine[Any, Any, T], limit_s: float) -> T:
    async with asyncio.timeout(limit_s):
        return await work
