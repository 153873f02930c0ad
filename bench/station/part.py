"""Part of a station: work that is repeated, and goes on after an error of the disk or of a file."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from contextlib import suppress

from bench.clock import Stopwatch
from bench.errors import BenchError, error_message


class Part(ABC):
    """Work of a station, repeated every `every_s` seconds, or sooner after `wake`.

    `problem` is the error of the last time, or "". `looks` counts; without one for `stuck_after_s` the part is stuck.
    """

    every_s = 0.5
    stuck_after_s = 120.0

    def __init__(self) -> None:
        self.problem = ""
        self.looks = 0
        self.looked = Stopwatch()
        self._woken = asyncio.Event()

    @property
    def is_stuck(self) -> bool:
        """True if a look takes longer than it ever should."""
        return self.looked.elapsed_s() > self.every_s + self.stuck_after_s

    def wake(self) -> None:
        """Look at once."""
        self._woken.set()

    @abstractmethod
    async def look(self) -> None:
        """Do what is to be done now."""

    async def work(self) -> None:
        """Repeat the work until cancelled. An error of this program ends it, and with it the station."""
        while True:
            self._woken.clear()
            try:
                await self.look()
                self.problem = ""
            except (BenchError, OSError) as problem:
                self.problem = error_message(problem) if isinstance(problem, BenchError) else str(problem)
            self.looks, self.looked = self.looks + 1, Stopwatch()
            with suppress(TimeoutError):
                async with asyncio.timeout(self.every_s):  # wait_for of Python 3.11 can lose a cancellation
                    await self._woken.wait()
