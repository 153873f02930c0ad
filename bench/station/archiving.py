"""Part of a station that publishes runs to its archive once their reports are approved."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE
from pathlib import Path

from bench.errors import BenchError
from bench.files import mark_of
from bench.report.approval import APPROVAL
from bench.station.part import Part

SHOWN_LINES = 3


class Archiving(Part):
    """Part that calls `bench archive push --pending --approved` whenever an approval is new or has changed.

    The command is a process of its own: it needs libraries and time that the station does not have. The first look is
    at all runs, since the station may have been stopped meanwhile; a push that failed is tried again.
    """

    every_s = 60.0
    stuck_after_s = 4 * 3600.0  # of many runs, to a bucket far away

    def __init__(self, destination: str, runs: Path) -> None:
        super().__init__()
        self._destination, self._runs = destination, runs
        self._pushed: frozenset[tuple[str, object]] | None = None

    async def look(self) -> None:
        """Publish what is new. Raises BenchError with the last lines of the command if it failed."""
        approved = await asyncio.to_thread(self._approvals)
        if approved and approved != self._pushed:
            await self._push()
        self._pushed = approved

    def _approvals(self) -> frozenset[tuple[str, object]]:
        if not self._runs.is_dir():
            return frozenset()
        return frozenset((str(path.parent), mark_of(path)) for path in self._runs.glob(f"*/{APPROVAL}"))

    async def _push(self) -> None:
        words = ("archive", "push", "--pending", "--approved", self._destination, "--runs", str(self._runs))
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "bench", *words, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE
        )
        try:
            _, said = await process.communicate()
        except asyncio.CancelledError:
            process.kill()  # whatever is cut is completed by the next push
            await process.wait()
            raise
        if process.returncode:
            lines = said.decode(errors="replace").strip().splitlines()[-SHOWN_LINES:]
            raise BenchError(f"the archive {self._destination}: {' '.join(lines) or f'exit code {process.returncode}'}")
