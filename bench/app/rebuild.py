"""The simulated world of an interrupted run: gone through again up to the interruption, then through an outage."""

from __future__ import annotations

import asyncio
import concurrent.futures
import json
import random
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from bench.app.resume import RESUMED, Resumption
from bench.engine.ending import EndRequest
from bench.engine.past import Past, past_of
from bench.errors import InputError
from bench.loop import BenchLoop
from bench.runner.signals import Sent, Signals
from bench.store.reader import Event
from bench.store.writer import RunWriter
from drivers.frame_block import FrameBlock
from drivers.values import Reading

OUTAGE_S = (60.0, 7200.0)  # of a simulated bench, drawn with equal chance for each ratio
KILLED = Sent("interruption", EndRequest("interruption", "interrupted"))
_FROM_OUTSIDE = frozenset({"run_begins", "run_ended", RESUMED, "warning", "clock_step", "stalled"})
"""Entries that are not written by the plan and its devices."""
GoThrough = Callable[[RunWriter, Signals, Past | None], Awaitable[object]]


class Scratch(RunWriter):
    """A writer that keeps the journal alone, in memory, with the timing of one that writes."""

    def __init__(self, expected: int, reached: Callable[[], object]) -> None:
        """`reached` is called with the last of as many entries as are `expected`."""
        self.folder = Path()
        self.entries: list[tuple[float, str, str, str]] = []
        self._expected, self._reached = expected, reached
        self.on_failure = lambda _: None

    def event(self, kind: str, step: str = "", **data: Any) -> None:
        """Kept."""
        text = json.dumps(data, ensure_ascii=False, sort_keys=True, allow_nan=False)
        self.entries.append((asyncio.get_running_loop().time(), kind, step, text))
        if len(self.entries) == self._expected:
            self._reached()

    def frames(self, stream: str, step: str, block: FrameBlock) -> None:
        """Not kept."""

    def samples(self, stream: str, step: str, readings: Sequence[Reading]) -> None:
        """Not kept."""

    def readings(self, name: str, unit: str, readings: Sequence[Reading]) -> None:
        """Not kept."""

    async def commit(self) -> None:
        """Return in the turn of the loop in which the disk would have answered."""
        done: concurrent.futures.Future[None] = concurrent.futures.Future()
        done.set_result(None)
        loop = asyncio.get_running_loop()
        if isinstance(loop, BenchLoop):
            await loop.admit(done)


async def rebuild(resumption: Resumption, seed: int, go_through: GoThrough) -> None:
    """Take a simulated world to where it is when the run is resumed.

    `go_through` does the plan once more with a writer, signals, and what was done before. Every stretch of the run ends
    where it was interrupted, with the bench made safe, and is followed by its outage. Raises InputError when the run
    does not go as it did.
    """
    loop = asyncio.get_running_loop()
    outage = random.Random(seed)  # noqa: S311  of a simulation
    for before, stretch in _stretches(resumption.entries):
        later = next(iter(resumption.entries[len(before) + len(stretch) :]), None)
        interrupted_s = resumption.last_s if later is None else float(later.data["interrupted_s"])
        again = await _once_more(stretch, interrupted_s, past_of(before) if before else None, go_through)
        _expect_the_same(stretch, again, resumption.path.name)
        low_s, high_s = OUTAGE_S
        drawn_s = low_s * (high_s / low_s) ** outage.random()
        await _until(loop.time() + drawn_s if later is None else later.at_s)


async def _once_more(
    stretch: Sequence[Event], interrupted_s: float, past: Past | None, go_through: GoThrough
) -> list[tuple[float, str, str, str]]:
    """Go through a stretch up to its interruption; its entries in the journal."""
    loop, signals = asyncio.get_running_loop(), Signals()

    def interrupt() -> None:
        loop.call_at(interrupted_s, signals.tell, KILLED)

    expected = sum(entry.kind not in _FROM_OUTSIDE for entry in stretch)
    if not expected:
        interrupt()
    writer = Scratch(expected, interrupt)
    await go_through(writer, signals, past)
    return writer.entries


async def _until(when_s: float) -> None:
    """Return at an instant of bench time, to the last bit."""
    loop = asyncio.get_running_loop()
    reached: asyncio.Future[None] = loop.create_future()
    loop.call_at(when_s, reached.set_result, None)
    await reached


def _stretches(entries: Sequence[Event]) -> list[tuple[Sequence[Event], Sequence[Event]]]:
    """The parts of a journal between interruptions, each with all before it."""
    begins = [index for index, entry in enumerate(entries) if index == 0 or entry.kind == RESUMED]
    ends = [*begins[1:], len(entries)]
    return [(entries[:begin], entries[begin:end]) for begin, end in zip(begins, ends, strict=True)]


def _expect_the_same(stretch: Sequence[Event], again: Sequence[tuple[float, str, str, str]], run: str) -> None:
    recorded = [
        (entry.at_s, entry.kind, entry.step, json.dumps(entry.data, ensure_ascii=False, sort_keys=True))
        for entry in stretch
        if entry.kind not in _FROM_OUTSIDE
    ]
    for before, now in zip(recorded, again, strict=False):
        if before != now:
            raise InputError(
                f"{run}: its simulated bench cannot be rebuilt: at {before[0]:.3f} s the run had {before[1]} "
                f"{before[2]} {before[3]}, and now has {now[1]} {now[2]} {now[3]} at {now[0]:.3f} s"
            )
    if len(again) < len(recorded):
        raise InputError(f"{run}: its simulated bench cannot be rebuilt: the run now ends sooner")
