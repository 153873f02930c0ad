"""P1: nights in virtual time, every wire encoded and decoded: an hour of one beside peers, and whole ones."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np

from bench.store.reader import RunReader
from benchmarks.compared import FROM_TWICE, Row, Side, in_turn
from benchmarks.night import night
from benchmarks.peers import figures, version_of
from benchmarks.timed_run import CONFIG, timed_run

HOUR_S = 3600.0
TIMES = 10
TIMES_REAL_TIME = 10_000
MORE = 1.2  # of the time of the tumble, for the night of an inertial unit
CHANNELS, RATE_HZ = 6, 100.0
BLOCK = 6000  # latches of a channel that the simulated counter computes at once between movements: 60 s
DURABLE = "each step synced, frames within 1 s"
AXES = 3  # each attitude is a move of each of them
PEERS: dict[str, tuple[str, str, str, tuple[str, ...], float]] = {
    # name: environment, script, durability, its further words, and the share of an hour in a slice
    "openhtf": ("openhtf", "openhtf_night.py", "JSON at the end", (), 0.04),
    "bluesky": ("bluesky", "bluesky_night.py", "JSON lines, not synced", ("buffered",), 0.004),
    "bluesky, synced": ("bluesky", "bluesky_night.py", "each document synced", ("synced",), 0.004),
}


@dataclass(frozen=True)
class Work:
    """What an hour of the night has on average."""

    moves: float  # of one axis
    waits: float
    readings: float  # of six channels

    def words(self) -> tuple[str, ...]:
        """The numbers, for a script of a peer."""
        return (f"{self.moves}", f"{self.waits}", f"{self.readings}")


def measure(whole: bool) -> Iterator[Row]:
    """An hour beside peers, then whole nights."""
    yield beside_peers(whole)
    yield from whole_nights()


def whole_nights() -> Iterator[Row]:
    """Speed of the tumble of an accelerometer, and of the night of an inertial unit with six channels at 100 Hz."""
    with tempfile.TemporaryDirectory() as name:
        folder, hours = Path(name), {"tumble": 0.0, "unit": 0.0}

        def times(kind: str) -> float:
            bench = CONFIG / "simulated.yaml"
            took = night(folder, whole=True) if kind == "unit" else timed_run("tumble_static", bench, folder / "runs")
            hours[kind] = took.bench_s / HOUR_S
            return took.bench_s / took.wall_s

        found = in_turn({**{kind: partial(times, kind) for kind in hours}, "noise": noise_of_an_hour_s})
    tumble, unit = (Side("this program", DURABLE, found[kind]) for kind in hours)
    tumble_s, unit_s = (HOUR_S * hours[kind] / side.value for kind, side in (("tumble", tumble), ("unit", unit)))
    yield _speed(f"a tumble of {hours['tumble']:.0f} h", tumble)
    more, noise_s = unit_s / tumble_s, hours["unit"] * median(found["noise"])
    what = f"a night of M2 of {hours['unit']:.0f} h, six channels at 100 Hz: {more:.2f} × the time of the tumble"
    least = hours["unit"] / hours["tumble"] + noise_s / tumble_s
    limit = f"as many hours of a tumble, and {noise_s:.2f} s to draw the noise of all samples: {least:.2f} × its time"
    yield _speed(what, unit, limit, f" and ≤ {MORE} × the time", is_met=more <= MORE)


def noise_of_an_hour_s() -> float:
    """Time in s that NumPy takes to draw the noise of all channels for an hour, in the blocks of the simulation."""
    draws, block = np.random.default_rng(0), np.empty(BLOCK)
    begun_s = time.perf_counter()
    for _ in range(round(CHANNELS * RATE_HZ * HOUR_S / BLOCK)):
        draws.standard_normal(out=block)
    return time.perf_counter() - begun_s


def _speed(work: str, side: Side, limit: str = "", goal: str = "", *, is_met: bool = True) -> Row:
    """Row of a speed: met if it reaches TIMES_REAL_TIME, and if the further goal `is_met`."""
    fast = side.value >= TIMES_REAL_TIME
    goal = f"≥ {TIMES_REAL_TIME:,} ×{goal}"
    return Row("P1", work, "× real time", side, (), limit, goal, fast and is_met, lower_is_better=False)


def beside_peers(whole: bool) -> Row:
    """Seconds of an hour of the night, beside the same moves, waits and readings by peers with their sleeps faked."""
    with tempfile.TemporaryDirectory() as name:
        first = night(Path(name), whole)
        work = work_of(first.path, first.bench_s / HOUR_S)

        def ours() -> float:
            again = night(Path(name), whole)
            return again.wall_s / (again.bench_s / HOUR_S)

        sides: dict[str, Callable[[], float]] = {"": ours}
        longer = 25 if whole else 1
        for each, (*_, share) in PEERS.items():
            sides[each] = partial(peer_s, each, share * longer, work)
        found = in_turn(sides)
        growth = {each: peer_s(each, share * longer * 2, work) for each, (*_, share) in PEERS.items()}
    peers = tuple(
        Side(
            title(each),
            f"{PEERS[each][2]}; {FROM_TWICE} {growth[each]:,.0f} s",
            found[each],
        )
        for each in PEERS
    )
    what = f"an hour of a night of M2: {work.moves:.0f} moves, {work.waits:.0f} waits, {work.readings:,.0f} readings"
    side = Side("this program", DURABLE, found[""])
    row = Row("P1", f"{what} of six channels", "s", side, peers, "", f"≥ {TIMES} ×", False)
    return Row(**{**vars(row), "is_met": all(row.ratio(peer) >= TIMES for peer in peers)})


def work_of(run: Path, hours: float) -> Work:
    """Moves, waits and readings of an hour, counted in the record of the night."""
    with RunReader(run) as record:
        verbs = Counter(event.step.rpartition("/")[2].partition("#")[0] for event in record.events("step_begins"))
        readings = sum(
            int(np.unique(block.ids, return_counts=True)[1].max()) for _, step, block in record.blocks() if step
        )
    moves = AXES * verbs["orient"] + verbs["rotate"]
    waits = verbs["orient"] + verbs["ramp"] + verbs["soak"] + verbs["wait"]
    return Work(moves / hours, waits / hours, readings / hours)


def peer_s(name: str, share: float, work: Work) -> float:
    """Seconds of an hour by a peer, from a share of it."""
    environment, script, _, further, _ = PEERS[name]
    return float(figures(environment, script, f"{share}", *work.words(), *further)["s_per_hour"])


def title(name: str) -> str:
    """A peer with its version."""
    package, _, how = name.partition(", ")
    return f"{package} {version_of(PEERS[name][0], package)}{f', {how}' if how else ''}"
