"""The only place that looks at a clock: bench time, which may be virtual, and wall time, which never is."""

from __future__ import annotations

import asyncio
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

SMALLEST_STEP_S = 0.5
SLEWED = 0.001


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
    """Real seconds since it was made, and those before, whatever bench time does; the computer's sleep counts."""

    def __init__(self, before_s: float = 0.0) -> None:
        self._start_s = since_boot_s() - before_s

    def elapsed_s(self) -> float:
        """Real seconds gone by."""
        return since_boot_s() - self._start_s


class ClockWatch:
    """Notices when the computer's clock is set, and when the computer sleeps, between two looks.

    A clock that is kept in step with others is only made a little faster or slower, by at most `SLEWED`.
    """

    def __init__(self) -> None:
        self._last = self._now()

    def look(self) -> tuple[float, float]:
        """Seconds by which the clock was set since the last look, and for which the computer slept; 0 for neither."""
        wall_s, boot_s, awake_s = self._now()
        wall_before_s, boot_before_s, awake_before_s = self._last
        self._last = wall_s, boot_s, awake_s
        passed_s = boot_s - boot_before_s
        set_by_s, slept_s = wall_s - wall_before_s - passed_s, passed_s - (awake_s - awake_before_s)
        smallest_s = SMALLEST_STEP_S + SLEWED * passed_s
        return set_by_s if abs(set_by_s) > smallest_s else 0.0, slept_s if slept_s > SMALLEST_STEP_S else 0.0

    @staticmethod
    def _now() -> tuple[float, float, float]:
        return time.time(), since_boot_s(), time.monotonic()


def since_boot_s() -> float:
    """Seconds since the start of the computer, which nobody sets; its sleep counts."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def boot_id() -> str:
    """Identifier of this start of the computer, another one after each; empty where the system has none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
    except OSError:
        return ""


def wall_utc() -> datetime:
    """The computer's idea of UTC now."""
    return datetime.now(UTC)
