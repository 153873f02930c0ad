"""Record steps of the computer's clock, its sleep, and suspensions of this program in the journal of a run."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

from bench.clock import ClockWatch, Stopwatch
from bench.engine.journal import Journal
from bench.errors import StoreError
from drivers.timing.awake import stalled_s

LOOK_EVERY_S = 10.0
STALL_TOLD_S = 1.0


class ClockRecord:
    """Journals `clock_step` when the clock is set or the computer sleeps, and keeps them in `steps`.

    Journals `stalled` when this program did not run.

    It checks every `LOOK_EVERY_S` of bench time, and at the end.
    """

    def __init__(self, journal: Journal, notice: Callable[[str], None]) -> None:
        self._journal, self._notice = journal, notice
        self._watch, self._since = ClockWatch(), Stopwatch()
        self.steps: list[dict[str, float]] = []

    @asynccontextmanager
    async def watched(self) -> AsyncIterator[None]:
        """Watch the clocks inside the context, and once more at its end."""
        looking = asyncio.create_task(self._watch_clock(), name="clock")
        try:
            yield
        finally:
            looking.cancel()
            self._look()

    async def _watch_clock(self) -> None:
        while True:
            looked_s = asyncio.get_running_loop().time()
            await asyncio.sleep(LOOK_EVERY_S)
            self._look()
            if (stood_s := stalled_s(looked_s)) >= STALL_TOLD_S:
                with suppress(StoreError):
                    self._journal.write("stalled", for_s=round(stood_s, 1))
                self._notice(f"This program was suspended for {stood_s:.1f} s; the bench was not monitored.")

    def _look(self) -> None:
        set_by_s, slept_s = self._watch.look()
        if not set_by_s and not slept_s:
            return
        step = {"after_s": round(self._since.elapsed_s(), 1), "set_by_s": round(set_by_s, 3), "slept_s": round(slept_s)}
        self.steps.append(step)
        with suppress(StoreError):  # reported by the step that it stops
            self._journal.write("clock_step", set_by_s=step["set_by_s"], slept_s=step["slept_s"])
        if set_by_s:
            self._notice(f"The computer's clock was set by {set_by_s:+.1f} s. The times of this run are unaffected.")
        if slept_s:
            self._notice(f"The computer slept for {slept_s:.0f} s; the bench was not monitored.")
