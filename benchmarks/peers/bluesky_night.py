"""A share of an hour of a night by the RunEngine with simulated devices of ophyd-async, in virtual time.

SHARE MOVES WAITS READINGS SYNC: as many moves of an axis, waits, and readings of six channels at 100 Hz as an hour has,
times SHARE; with SYNC `synced` each document is on the disk before the next one.
"""

import asyncio
import json
import os
import selectors
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
from bluesky import Msg, RunEngine
from bluesky.callbacks.json_writer import JSONLinesWriter
from ophyd_async.core import SignalRW, StandardReadable, init_devices, soft_signal_rw

CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")


class Jumping(selectors.DefaultSelector):
    """A selector that moves the clock of its loop instead of waiting for a timer."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list:
        """What is ready; with nothing ready the time of the next timer is now."""
        if timeout is None:
            return super().select(None)
        ready = super().select(0)
        if not ready:
            self.now_s += max(0.0, timeout)
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop without waits."""

    def __init__(self) -> None:
        self.jumping = Jumping()
        super().__init__(self.jumping)

    def time(self) -> float:
        """Virtual time in s."""
        return self.jumping.now_s


class Counter(StandardReadable):
    """Six counts in memory."""

    def __init__(self, name: str = "") -> None:
        with self.add_children_as_readables():
            for channel in CHANNELS:
                setattr(self, channel, soft_signal_rw(int))
        super().__init__(name)


def synced(path: Path) -> Callable[[str, dict], None]:
    """A writer of JSON lines that syncs each of them."""
    out = path.open("w", encoding="utf-8")

    def write(name: str, document: dict) -> None:
        out.write(json.dumps({"name": name, "doc": document}) + "\n")
        out.flush()
        os.fsync(out.fileno())

    return write


def night(axis: SignalRW, counter: Counter, moves: int, waits: int, readings: int) -> Iterator[Msg]:
    """Moves, waits and readings, each acquisition after its move."""
    for number in range(moves):
        yield from bps.mv(axis, float(number % 7) + 1.0)
        for _ in range(waits * number // moves, waits * (number + 1) // moves):
            yield from bps.sleep(5.0)
        for _ in range(readings * number // moves, readings * (number + 1) // moves):
            yield from bps.trigger_and_read([counter, axis])
            yield from bps.sleep(0.01)


share = float(sys.argv[1])
moves, waits, readings = (max(1, round(float(each) * share)) for each in sys.argv[2:5])
engine = RunEngine({}, loop=VirtualLoop())
with init_devices():
    axis, counter = soft_signal_rw(float, name="axis"), Counter()
with tempfile.TemporaryDirectory() as folder:
    is_synced = sys.argv[5] == "synced"
    engine.subscribe(synced(Path(folder) / "run.jsonl") if is_synced else JSONLinesWriter(folder, "run.jsonl"))
    began_s = time.perf_counter()
    engine(bpp.run_wrapper(night(axis, counter, moves, waits, readings)))
    took_s = time.perf_counter() - began_s
print(json.dumps({"s_per_hour": took_s / share, "readings": readings}))
