"""Parts of a station for its approvals: files of a station that died meanwhile, and a key that no longer signs."""

from __future__ import annotations

import asyncio
from pathlib import Path

from bench.errors import BenchError
from bench.station.part import Part
from bench.station.signoff.decisions import Pending, SignOff
from bench.station.signoff.files import settle, usable_key
from bench.station.signoff.key import KeyFiles
from bench.station.worker import Workers


class Placing(Part):
    """Part that makes the files of each run what its decisions say. `runs` is the folder of run directories."""

    every_s = 30.0

    def __init__(self, sign_off: SignOff, runs: Path) -> None:
        super().__init__()
        self._sign_off, self._runs = sign_off, runs
        self._one = asyncio.Lock()

    async def look(self) -> None:
        """Settle all decisions that are pending. Raises the error of the last one that could not be."""
        problem: BenchError | None = None
        for each in self._sign_off.pending():
            try:
                await self.settle(each)
            except BenchError as found:  # one run must not stand in the way of others
                problem = found
        if problem is not None:
            raise problem

    async def settle(self, pending: Pending) -> None:
        """Make the files of a run what a decision says. Raises StoreError; it is tried again."""
        async with self._one:
            await asyncio.to_thread(settle, self._runs / pending.signed.run, pending)
            self._sign_off.done(pending)


class UsableKey(Part):
    """Part that shows when the key of the station cannot sign, before somebody approves."""

    every_s = 3600.0

    def __init__(self, key: KeyFiles, workers: Workers) -> None:
        super().__init__()
        self._key, self._workers = key, workers

    async def look(self) -> None:
        """Raise InputError if the key cannot sign now."""
        await self._workers.call(usable_key, self._key)
