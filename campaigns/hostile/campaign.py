"""Many documents in several processes, and the account of what came of them."""

from __future__ import annotations

import resource
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path

from campaigns.hostile.documents import hostile
from campaigns.hostile.trial import LIMIT_S, Readers, Reading

BATCH = 500
MEMORY_BYTES = 4 * 1024**3  # what a process may take before it is told that there is no more
_PERCENTILES = (50, 90, 99, 99.9, 100)


@dataclass
class Account:
    """Counts by way and outcome, times, those of long plans above LIMIT_S by themselves, and what should not be."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    times_s: dict[str, list[float]] = field(default_factory=dict)
    slow: list[Reading] = field(default_factory=list)
    offences: list[Reading] = field(default_factory=list)
    long_plans_s: list[float] = field(default_factory=list)
    peak_kib: int = 0

    def add(self, readings: list[Reading]) -> None:
        """Count the readings in."""
        for reading in readings:
            self.outcomes[reading.way, reading.outcome] += 1
            self.times_s.setdefault(reading.way, []).append(reading.time_s)
            if reading.is_long_plan and reading.time_s > LIMIT_S:
                self.long_plans_s.append(reading.time_s)
            if reading.is_offence:
                self.offences.append(reading)
            elif reading.is_slow:
                self.slow.append(reading)

    def alike(self) -> list[list[Reading]]:
        """The offences, those of one kind in one place of the program together."""
        found: dict[tuple[str, str], list[Reading]] = {}
        for reading in self.offences:
            found.setdefault((reading.outcome, reading.place), []).append(reading)
        return list(found.values())

    def percentiles_ms(self, way: str) -> list[tuple[float, float]]:
        """Percentiles of the times of one way, in ms."""
        times_s = sorted(self.times_s[way])
        return [(part, 1e3 * times_s[round((len(times_s) - 1) * part / 100)]) for part in _PERCENTILES]


def campaign(seed: int, first: int, count: int, jobs: int, kind: str = "") -> Account:
    """Read the documents `first` to `first + count - 1`; what was slow is read again, alone, before it counts.

    With a kind, only those whose kind begins so.
    """
    account = Account()
    batches = [range(begin, min(begin + BATCH, first + count)) for begin in range(first, first + count, BATCH)]
    with ProcessPoolExecutor(jobs) as pool:
        running = {pool.submit(_batch, seed, batch, kind): batch for batch in batches}
        for done in as_completed(running):
            account.add(_readings(done, running[done], account))
    account.slow = [again for again in _again(seed, account.slow) if again.is_slow]
    return account


def _readings(done: Future[tuple[list[Reading], int]], batch: range, account: Account) -> list[Reading]:
    try:
        readings, peak_kib = done.result()
    except BrokenProcessPool:
        return [Reading(batch[0], "", f"one of the documents to {batch[-1]}", "not read: a process died", 0.0)]
    account.peak_kib = max(account.peak_kib, peak_kib)
    return readings


def _batch(seed: int, indices: range, kind: str) -> tuple[list[Reading], int]:
    """The readings of some documents, in a process of the pool, and the memory that it has taken at most, in KiB."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    with tempfile.TemporaryDirectory() as folder:
        readers = Readers(Path(folder))
        documents = (hostile(seed, index) for index in indices)
        readings = [one for document in documents if document.kind.startswith(kind) for one in readers.read(document)]
    return readings, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _again(seed: int, slow: list[Reading]) -> Iterator[Reading]:
    """The quicker of two more readings of each, alone: other programs make everything slow now and then."""
    with tempfile.TemporaryDirectory() as folder:
        readers = Readers(Path(folder))
        for first in slow:
            document = hostile(seed, first.index)
            again = [readers.read_again(document, first.way) for _ in range(2)]
            yield min(first, *again, key=lambda one: one.time_s)
