"""Part of a station: work that is repeated, and goes on after an error of the disk or of a file."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod

from bench.errors import BenchError, error_message


class Part(ABC):
    """Work of a station, repeated every `every_s` seconds, or sooner after `wake`.

    `problem` is the error of the last time, or "".
    """

    every_s = 0.5

    def __init__(self) -> None:
        self.problem = ""
        self._woken = asyncio.Event()

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
            try:
                await asyncio.wait_for(self._woken.wait(), self.every_s)
            except TimeoutError:
                continue
