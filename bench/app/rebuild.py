"""Reconstruction of the simulated world of an interrupted run: repeated up to the interruption, then an outage."""

from __future__ import annotations

import asyncio
import random
import shutil
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench.app.resume import RESUMED, Resumption
from bench.engine.ending import EndRequest
from bench.engine.journal import Journal
from bench.engine.past import Past, past_of
from bench.errors import InputError
from bench.runner.signals import EndSignal, Signals
from bench.store.database import FILE_NAME
from bench.store.reader import Event, RunReader
from bench.store.runs import MANIFEST, RESERVE, RUNNER, json_text
from bench.store.writer import RunWriter

OUTAGE_S = (60.0, 7200.0)  # of a simulated bench, log-uniform
KILLED = EndSignal("interruption", EndRequest("interruption", "interrupted"))
_FROM_OUTSIDE = frozenset({"run_begins", "preflight", "run_ended", RESUMED, "warning", "clock_step", "stalled"})
"""Kinds of entries that the plan and its devices do not write."""
GoThrough = Callable[[Journal, Signals, Past | None], Awaitable[object]]


class _ReplayWriter(RunWriter):
    """Writer that calls `reached` with the last of the `expected` number of journal entries."""

    def __init__(self, folder: Path, expected: int, reached: Callable[[], object], *, resumed: bool) -> None:
        super().__init__(folder, resumed=resumed, noted=False)
        self._left, self._reached = expected, reached

    def event(self, kind: str, step: str = "", **data: Any) -> None:
        """Append an entry, and count it."""
        super().event(kind, step, **data)
        self._left -= 1
        if self._left == 0:
            self._reached()


async def rebuild(resumption: Resumption, seed: int, go_through: GoThrough) -> None:
    """Bring a simulated world to its state when the run is resumed.

    `go_through` executes the plan again with a journal, signals and the past. Every stretch of the run ends where it
    was interrupted, with the bench made safe, and is followed by its outage. Raises InputError if the repetition
    differs from the run.
    """
    outage = random.Random(seed)  # noqa: S311  of a simulation
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / resumption.path.name
        shutil.copytree(resumption.path, folder, ignore=shutil.ignore_patterns(f"{FILE_NAME}*", RESERVE, RUNNER))
        manifest = {**resumption.manifest, "run": "rebuilt"}  # without entries in the ledger
        (folder / MANIFEST).write_text(json_text(manifest), "utf-8")
        for before, stretch in _stretches(resumption.entries):
            later = next(iter(resumption.entries[len(before) + len(stretch) :]), None)
            interrupted_s = resumption.last_s if later is None else float(later.data["interrupted_s"])
            past = past_of((*before, stretch[0])) if before else None
            again = await _once_more(folder, stretch, interrupted_s, past, go_through)
            _expect_the_same(stretch, again, resumption.path.name)
            low_s, high_s = OUTAGE_S
            drawn_s = low_s * (high_s / low_s) ** outage.random()
            await _until(asyncio.get_running_loop().time() + drawn_s if later is None else later.at_s)


async def _once_more(
    folder: Path, stretch: Sequence[Event], interrupted_s: float, past: Past | None, go_through: GoThrough
) -> list[Event]:
    """Repeat a stretch up to its interruption; return its journal entries."""
    loop, signals = asyncio.get_running_loop(), Signals()

    def interrupt() -> None:
        loop.call_at(interrupted_s, signals.request_end, KILLED)

    expected = sum(entry.kind not in _FROM_OUTSIDE for entry in stretch)
    if not expected:
        interrupt()
    writer = _ReplayWriter(folder, expected, interrupt, resumed=past is not None)
    had = writer.link.rows["journal"]
    try:
        await go_through(Journal(writer, None if past is None else past.state), signals, past)
    finally:
        writer.close()
    with RunReader(folder) as reader:
        return list(reader.events())[had:]


async def _until(when_s: float) -> None:
    """Sleep until an exact instant of bench time."""
    loop = asyncio.get_running_loop()
    reached: asyncio.Future[None] = loop.create_future()
    loop.call_at(when_s, reached.set_result, None)
    await reached


def _stretches(entries: Sequence[Event]) -> list[tuple[Sequence[Event], Sequence[Event]]]:
    """Return the parts of a journal between interruptions, each with all entries before it."""
    begins = [index for index, entry in enumerate(entries) if index == 0 or entry.kind == RESUMED]
    ends = [*begins[1:], len(entries)]
    return [(entries[:begin], entries[begin:end]) for begin, end in zip(begins, ends, strict=True)]


def _expect_the_same(stretch: Sequence[Event], again: Sequence[Event], run: str) -> None:
    recorded = [entry for entry in stretch if entry.kind not in _FROM_OUTSIDE]
    for before, now in zip(recorded, again, strict=False):
        if before._replace(seq=now.seq) != now:
            raise InputError(
                f"{run}: its simulated bench cannot be rebuilt: at {before.at_s:.3f} s the run had {before.kind} "
                f"{before.step} {before.data}, and now has {now.kind} {now.step} {now.data} at {now.at_s:.3f} s"
            )
    if len(again) < len(recorded):
        raise InputError(f"{run}: its simulated bench cannot be rebuilt: the run now ends sooner")
