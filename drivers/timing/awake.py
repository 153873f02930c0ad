"""Time limits that count only the running time of this program; a suspension is no silence of an instrument.

While the computer swaps or is suspended, or the process is stopped, answers stay in buffers. An event loop that detects
this reports it by `stalled_since`; with any other loop all time counts. Threads wait in slices.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

ROUNDING_S = 1e-9  # rounding error of loop times, which are sums
SLICE_S = 0.25


def succeeded_within(wait: Callable[[float], bool], limit_s: float) -> bool:
    """Return whether `wait`, which waits for at most the given time, has succeeded within the limit; for threads.

    Each slice counts as its nominal length, however long it took.
    """
    left_s = limit_s
    while left_s > 0:
        if wait(SLICE_S):
            return True
        left_s -= SLICE_S
    return False


def now_s() -> float:
    """Present time on the clock of the running loop."""
    return asyncio.get_running_loop().time()


def stalled_s(since_s: float) -> float:
    """Time for which the running loop was suspended since an instant on its clock."""
    stalled_since: Callable[[float], float] | None = getattr(asyncio.get_running_loop(), "stalled_since", None)
    return stalled_since(since_s) if stalled_since is not None else 0.0


def awake_s(since_s: float) -> float:
    """Time for which the running loop was not suspended since an instant on its clock."""
    return now_s() - since_s - stalled_s(since_s)


class Deadline:
    """A time limit that begins now."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s, self._since_s = limit_s, asyncio.get_running_loop().time()

    @property
    def passed(self) -> bool:
        """True if the loop has run for the time limit."""
        return self.left_s <= ROUNDING_S

    @property
    def left_s(self) -> float:
        """Remaining running time."""
        return self._limit_s - awake_s(self._since_s)


@asynccontextmanager
async def fair_timeout(limit_s: float) -> AsyncIterator[asyncio.Timeout]:
    """As asyncio.timeout, but data that have arrived by the time limit are processed before it expires."""
    loop, deadline = asyncio.get_running_loop(), Deadline(limit_s)
    timer: asyncio.Handle

    def look() -> None:
        """Give data that have arrived by the time limit one more iteration, which also reveals a suspension."""
        nonlocal timer
        timer = loop.call_later(deadline.left_s, look) if not deadline.passed else loop.call_soon(end)

    def end() -> None:
        if deadline.passed:
            limit.reschedule(loop.time())
        else:
            look()

    async with asyncio.timeout(None) as limit:
        timer = loop.call_later(limit_s, look)
        try:
            yield limit
        finally:
            timer.cancel()
