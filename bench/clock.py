"""The only place that looks at a clock: bench time, which may be virtual, and wall time, which never is."""

from __future__ import annotations

import asyncio
import time
from datetime import UTC, datetime, timedelta


class Clock:
    """Bench time: `monotonic` of the running loop, and UTC counted on from `start`.

    UTC follows the monotonic clock, so a step of the computer's clock cannot reorder a run.
    """

    def __init__(self, start: datetime | None = None) -> None:
        self._origin_s = self.monotonic()
        self._start = start if start is not None else wall_utc()

    def monotonic(self) -> float:
        """Seconds of bench time; differences are durations."""
        return asyncio.get_running_loop().time()

    def utc(self) -> datetime:
        """The UTC instant now."""
        return self._start + timedelta(seconds=self.monotonic() - self._origin_s)

    async def sleep(self, seconds: float) -> None:
        """Waits for bench time to pass."""
        await asyncio.sleep(seconds)


class Stopwatch:
    """Real seconds since it was made, whatever bench time does."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def elapsed_s(self) -> float:
        """Real seconds gone by."""
        return time.monotonic() - self._start_s


def wall_utc() -> datetime:
    """The computer's idea of UTC now."""
    return datetime.now(UTC)
