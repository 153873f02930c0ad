"""P4: 10⁷ samples to the disk and back to NumPy, and how many bytes each takes.

A sample is what one of six channels of an inertial unit has counted, from both of its counters. The frames are those of
a simulated night; the peers are given what was decoded of them: times of arrival, sequence numbers, ticks, and both
counters of all channels.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.config.bench import load_kept_bench
from bench.loop import run as run_loop
from bench.metrology.acquisition import Codes, Counts
from bench.store import database
from bench.store.decoder import Decoder, decoders_of
from bench.store.reader import Frames, RunReader
from bench.store.runs import BENCH_COPY
from bench.store.writer import RunWriter
from benchmarks.compared import FROM_TWICE, Row, Side, in_turn
from benchmarks.night import night
from benchmarks.peers import figures, version_of
from drivers.can.frame_block import FrameBlock

SAMPLES = 10_000_000
CHANNELS = 6
NS = 1e9
STREAM = "counter"
MOST_BYTES = 3.0
BLOCK = 1000  # rows: 10 s, at the end of which peers that can keep blocks write one


class Spent(NamedTuple):
    """Seconds for all samples, and bytes of each."""

    write_s: float
    read_s: float
    bytes_each: float


class Peer(NamedTuple):
    """How a peer is measured."""

    environment: str
    package: str
    how: str
    durability: str
    samples: int  # as many as take seconds
    further: tuple[str, ...] = ()


PEERS = (
    Peer("hdf5", "h5py", "SWMR", "flushed, not synced", SAMPLES, (str(BLOCK), "plain")),
    Peer("hdf5", "h5py", "SWMR, gzip 1 and shuffle", "flushed, not synced", SAMPLES, (str(BLOCK), "gzip")),
    Peer("qcodes", "qcodes", "arrays of 10 s", "SQLite, each block synced", SAMPLES // 40, (str(BLOCK),)),
    Peer("pymeasure", "pymeasure", "CSV", "not synced", SAMPLES // 40),
    Peer("tiled", "tiled", "events of Bluesky", "at the end of the run", 3000),
)


def measure(whole: bool) -> Iterator[Row]:
    """Writing, reading, and bytes of a sample, beside stores that laboratories use."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = night(folder, whole=False).path
        blocks, rows = frames_and_rows(source)
        emptied(source)
        spent: dict[str, list[Spent]] = {}

        def once(key: str, measured: Any) -> float:
            spent.setdefault(key, []).append(measured())
            return spent[key][-1].write_s

        sides = {"": partial(once, "", partial(ours, source, blocks))}
        for peer in PEERS:
            count = peer.samples * (20 if whole and peer.samples < SAMPLES else 1)
            path = folder / f"rows_{count}.npy"
            np.save(path, rows[: min(count, SAMPLES) // CHANNELS])
            sides[title(peer)] = partial(once, title(peer), partial(theirs, peer, path))
        in_turn(sides)
        raw_s = raw_write_s(folder / "raw", rows)
        twice = {title(peer): twice_as_many(peer, folder, rows) for peer in PEERS if peer.samples < SAMPLES}
    yield from table_rows(spent, raw_s, twice)


def frames_and_rows(run: Path) -> tuple[list[tuple[str, FrameBlock]], NDArray[np.int64]]:
    """The blocks of the first 10⁷ samples of a night, and a row for each latch: time, sequence, tick, all counters."""
    blocks, rows, found = [], [], 0
    with RunReader(run) as record:
        decoder = decoders_of(load_kept_bench(run / BENCH_COPY).devices, run)[STREAM]
        for stream, step, block in record.blocks():
            if not step or found >= SAMPLES // CHANNELS:
                continue
            counts = [each for each in decoder.outputs(block).values() if isinstance(each, Counts)]
            came_ns = np.rint(counts[0].host_s * NS).astype(np.int64)
            latch = (came_ns, counts[0].sequence, counts[0].tick)
            columns = [*latch, *(each.positive for each in counts), *(each.negative for each in counts)]
            rows.append(np.stack(columns, axis=1))
            blocks.append((stream, block))
            found += len(rows[-1])
    return blocks, np.concatenate(rows)


def emptied(run: Path) -> None:
    """Leave of a run what is kept beside the data."""
    for each in run.glob(f"{database.FILE_NAME}*"):
        each.unlink()


def ours(source: Path, blocks: Sequence[tuple[str, FrameBlock]]) -> Spent:
    """Write the blocks with a commit after each, and read them back as counts."""
    with tempfile.TemporaryDirectory(dir=source.parent) as name:
        run = Path(name) / "run"
        shutil.copytree(source, run)
        began_s = time.perf_counter()
        run_loop(written(run, blocks))
        write_s = time.perf_counter() - began_s
        size = (run / database.FILE_NAME).stat().st_size
        began_s = time.perf_counter()
        with RunReader(run) as record:
            decoder = decoders_of(load_kept_bench(run / BENCH_COPY).devices, run)[STREAM]
            steps = {f"steps/{number}": partial(counted, decoder) for number in range(len(blocks))}
            found = list(record.of_steps(steps))
        read_s = time.perf_counter() - began_s
    samples = sum(len(each.tick) for outputs in found for each in outputs.values())
    return Spent(write_s / samples * SAMPLES, read_s / samples * SAMPLES, size / samples)


async def written(run: Path, blocks: Sequence[tuple[str, FrameBlock]]) -> None:
    """Write each block as that of a step, and wait until it is on the disk."""
    writer = await asyncio.to_thread(RunWriter, run, noted=False)
    for number, (stream, block) in enumerate(blocks):
        writer.frames(stream, f"steps/{number}", block)
        await writer.commit()
    writer.close()


def counted(decoder: Decoder, frames: Frames) -> Mapping[str, Counts | Codes]:
    """Counts of all channels of a step."""
    return decoder.outputs(frames[STREAM])


def theirs(peer: Peer, rows: Path) -> Spent:
    """The same by a peer, from the rows it is given."""
    found = figures(peer.environment, f"{peer.environment}_samples.py", rows, *peer.further)
    samples = found["rows"] * CHANNELS
    share = samples / SAMPLES
    return Spent(found["write_s"] / share, found["read_s"] / share, found["bytes"] / samples)


def twice_as_many(peer: Peer, folder: Path, rows: NDArray[np.int64]) -> Spent:
    """A peer that is given a part, with two of them: whether its time grows as its work does."""
    path = folder / "twice.npy"
    np.save(path, rows[: 2 * peer.samples // CHANNELS])
    return theirs(peer, path)


def raw_write_s(path: Path, rows: NDArray[np.int64]) -> float:
    """Seconds for the rows in four bytes a number, in one piece and synced: what the disk takes."""
    data = rows.astype("<u4").tobytes()
    began_s = time.perf_counter()
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    return (time.perf_counter() - began_s) / len(rows) / CHANNELS * SAMPLES


def table_rows(spent: Mapping[str, Sequence[Spent]], raw_s: float, twice: Mapping[str, Spent]) -> Iterator[Row]:
    """A row for each of the three figures."""
    durability = {title(each): each.durability for each in PEERS}
    limits = (f"as 4 bytes a number, in one piece: {raw_s:.2f} s", "", "")
    whats = ("10⁷ samples to the disk", "10⁷ samples back to NumPy", "a sample on the disk")
    for at, (what, limit) in enumerate(zip(whats, limits, strict=True)):
        sides = []
        for name, found in spent.items():
            kept = durability.get(name, "each block synced")
            part = f"; {FROM_TWICE} {twice[name][at]:,.1f}" if name in twice else ""
            sides.append(Side(name or "this program", kept + part, tuple(each[at] for each in found)))
        goal = f"least, ≤ {MOST_BYTES:.0f} B" if at == 2 else "faster than each"
        row = Row("P4", what, "B" if at == 2 else "s", sides[0], tuple(sides[1:]), limit, goal, False)
        is_least = all(row.ratio(peer) > 1 for peer in row.peers)
        yield Row(**{**vars(row), "is_met": is_least and (at != 2 or row.ours.value <= MOST_BYTES)})


def title(peer: Peer) -> str:
    """A peer with its version."""
    return f"{peer.package} {version_of(peer.environment, peer.package)}, {peer.how}"
