"""Only access to clocks: bench time, which may be virtual, and wall time, which is always real."""

from __future__ import annotations

import asyncio
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

SMALLEST_STEP_S = 0.5
SLEWED = 0.001


class Clock:
    """Bench time: `monotonic` of the running loop, and UTC that advances from `start`.

    UTC follows the monotonic clock, so a step of the computer's clock cannot reorder a run.
    """

    def __init__(self, start: datetime | None = None) -> None:
        self._origin_s = self.monotonic()
        self._start = start if start is not None else wall_utc()

    def monotonic(self) -> float:
        """Return bench time in s; differences are durations."""
        return asyncio.get_running_loop().time()

    def utc(self) -> datetime:
        """Return the present instant in UTC."""
        return self._start + timedelta(seconds=self.monotonic() - self._origin_s)

    async def sleep(self, seconds: float) -> None:
        """Wait for a duration of bench time."""
        await asyncio.sleep(seconds)


class Stopwatch:
    """Elapsed real time in s, starting at `before_s` and independent of bench time; suspension counts."""

    def __init__(self, before_s: float = 0.0) -> None:
        self._start_s = since_boot_s() - before_s

    def elapsed_s(self) -> float:
        """Return the elapsed real time in s."""
        return since_boot_s() - self._start_s


class ClockWatch:
    """Detector of steps of the computer's clock and of suspension, between two calls.

    Clock discipline changes the rate by at most `SLEWED`, which is tolerated.
    """

    def __init__(self) -> None:
        self._last = self._now()

    def look(self) -> tuple[float, float]:
        """Return the step of the clock and the time of suspension since the last call, in s; 0 for none."""
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
    """Return the time since the start of the computer in s, suspension included; no clock setting affects it."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def boot_id() -> str:
    """Identifier of this start of the computer, another one after each; empty where the system has none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
    except OSError:
        return ""


def wall_utc() -> datetime:
    """Return UTC by the computer's clock."""
    return datetime.now(UTC)
