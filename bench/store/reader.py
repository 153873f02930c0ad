"""Reading of a run, finished or not."""

from __future__ import annotations

import json
import sqlite3
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.errors import StoreError
from bench.store import database
from bench.store.blocks import Packed, content_in, unpack, unpack_all
from bench.store.chain import ChainCheck, check_rows
from bench.store.digest import Digest
from bench.store.encoded import encoded
from bench.store.envelope import envelope
from drivers.can.frame_block import FrameBlock

BLOCKS_AHEAD = 8  # unpacked while the consumer works on one
BATCH_ROWS = 10_000
KEPT_READINGS = 150_000  # of a channel: 41 hours at one a second, 2.4 MB
ROUNDING_S = 1e-9
STEPS_AHEAD = 2  # steps whose blocks are unpacked ahead
_READING = np.dtype([("at_s", np.float64), ("value", np.float64)])
_BLOCKS = "SELECT stream, step, data, frames, crc FROM block ORDER BY seq"
_READINGS = "SELECT at_s, value FROM reading WHERE channel = ? ORDER BY seq"
_SPAN_OF_READINGS = "SELECT COUNT(*), MIN(at_s), MAX(at_s) FROM reading WHERE channel = ?"
_SEQS_OF_STEPS = "SELECT step, MIN(seq), MAX(seq) FROM block GROUP BY step ORDER BY MIN(seq)"
_BLOCKS_OF_STEP = "SELECT stream, data, frames, crc FROM block WHERE step = ? AND seq BETWEEN ? AND ? ORDER BY seq"


T = TypeVar("T")
Frames = dict[str, FrameBlock]
"""Frames of one step, by stream."""


class Event(NamedTuple):
    """Row of the journal."""

    seq: int
    at_s: float
    kind: str
    step: str
    data: Mapping[str, Any]


class Series(NamedTuple):
    """Readings of one channel over the run: `at_s` (N,) bench time and `values` (N,) in `unit`."""

    name: str
    unit: str
    at_s: NDArray[np.float64]
    values: NDArray[np.float64]

    def between(self, begin_s: float, end_s: float) -> Series:
        """Return the part from `begin_s` to `end_s`, both included."""
        low, high = bisect_left(self.at_s, begin_s), bisect_left(self.at_s, end_s + ROUNDING_S)
        return Series(self.name, self.unit, self.at_s[low:high], self.values[low:high])


class RunReader:
    """Reader of one run directory; a context manager. Raises StoreError for data that cannot be read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._database = database.open_to_read(folder / database.FILE_NAME)
        self._kept: dict[int, NDArray[np.float64]] = {}  # readings of short channels
        self._unpackers = ThreadPoolExecutor(1, "unpack")  # more would wait for the GIL

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._unpackers.shutdown()
        self._database.close()

    def _rows(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        try:
            yield from self._database.execute(query, values)
        except sqlite3.Error as problem:
            raise self._unreadable(problem) from problem

    def _batches(self, query: str, *values: object) -> Iterator[list[tuple[Any, ...]]]:
        """Yield the rows in batches; faster than `_rows` for hundreds of thousands of rows."""
        try:
            cursor = self._database.execute(query, values)
            while rows := cursor.fetchmany(BATCH_ROWS):
                yield rows
        except sqlite3.Error as problem:
            raise self._unreadable(problem) from problem

    def _unreadable(self, problem: sqlite3.Error) -> StoreError:
        return StoreError(f"{self.folder}: cannot be read ({problem})")

    def events(self, *kinds: str) -> Iterator[Event]:
        """Yield the entries of the journal in order, only those of `kinds` if any are given."""
        chosen = f"WHERE kind IN ({', '.join('?' * len(kinds))})" if kinds else ""
        query = f"SELECT seq, at_s, kind, step, data FROM journal {chosen} ORDER BY seq"  # noqa: S608  only marks
        for seq, at_s, kind, step, data in self._rows(query, *kinds):
            yield Event(seq, at_s, kind, step, self._data(seq, data))

    def _data(self, seq: int, text: object) -> Mapping[str, Any]:
        try:
            found = json.loads(text) if isinstance(text, str) else None
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise StoreError(f"{self.folder}: entry {seq} of the journal is damaged")
        return found

    def blocks(self) -> Iterator[tuple[str, str, FrameBlock]]:
        """Yield (stream, step, frames) of all blocks in order."""
        for stream, step, _, block in self._unpacking(unpack):
            yield stream, step, block

    def _unpacking(self, of: Callable[[Packed], T]) -> Iterator[tuple[str, str, int, T]]:
        """Yield (stream, step, number of frames, unpacked block) in order; blocks are unpacked ahead in a thread."""
        ahead: deque[tuple[str, str, int, Future[T]]] = deque()
        for stream, step, data, frames, crc in self._rows(_BLOCKS):
            ahead.append((stream, step, frames, self._unpackers.submit(of, Packed(data, frames, crc))))
            if len(ahead) > BLOCKS_AHEAD:
                yield _done(ahead.popleft())
        yield from map(_done, ahead)

    @cached_property
    def _seqs_of_steps(self) -> dict[str, tuple[int, int]]:
        """Numbers of the first and last block of each step, so that a query need not scan all blocks."""
        return {step: (first, last) for step, first, last in self._rows(_SEQS_OF_STEPS)}

    def frames_of(self, step: str) -> Frames:
        """Return all frames of a step, by stream."""
        return next(self.of_steps({step: dict}))

    def of_steps(self, make: Mapping[str, Callable[[Frames], T]]) -> Iterator[T]:
        """Yield the result of each function on all frames of its step, in order; a thread works some steps ahead."""
        ahead: deque[Future[T]] = deque()
        for step, made_of in make.items():
            packed = list(self._rows(_BLOCKS_OF_STEP, step, *self._seqs_of_steps.get(step, (0, -1))))
            ahead.append(self._unpackers.submit(_made, made_of, packed))
            if len(ahead) > STEPS_AHEAD:
                yield ahead.popleft().result()
        yield from (each.result() for each in ahead)

    def frames_by_step(self) -> dict[str, Frames]:
        """Return all frames, by step and stream."""
        return dict(zip(self._seqs_of_steps, self.of_steps(dict.fromkeys(self._seqs_of_steps, dict)), strict=True))

    def samples_by_step(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Return the samples read during steps, by step and stream: (N, 2), bench time in s and value."""
        collected: dict[str, dict[str, list[tuple[float, float]]]] = {}
        for stream, step, at_s, value in self._samples():
            collected.setdefault(step, {}).setdefault(stream, []).append((at_s, value))
        return {
            step: {stream: np.array(rows, np.float64) for stream, rows in streams.items()}
            for step, streams in collected.items()
        }

    def _samples(self) -> Iterator[tuple[Any, ...]]:
        """Yield rows of stream, step, time and value; runs of old formats have no such table."""
        if self._has_samples():
            yield from self._rows("SELECT stream, step, at_s, value FROM sample ORDER BY seq")

    def _has_samples(self) -> bool:
        return bool(next(self._rows("SELECT COUNT(*) FROM sqlite_master WHERE name = 'sample'"))[0])

    def frame_count(self) -> int:
        """Return the number of recorded frames."""
        return int(next(self._rows("SELECT COALESCE(SUM(frames), 0) FROM block"))[0])

    def span_s(self) -> tuple[float, float]:
        """Return the bench time of the first and the last record in s; zeros for an empty run."""
        query = (
            "SELECT (SELECT at_s FROM journal ORDER BY seq LIMIT 1), "
            "(SELECT at_s FROM journal ORDER BY seq DESC LIMIT 1), (SELECT at_s FROM reading ORDER BY seq DESC LIMIT 1)"
        )
        at_s = [float(found or 0.0) for found in next(self._rows(query))]
        return at_s[0], max(at_s)

    def channels(self) -> dict[str, str]:
        """Return the units of all recorded channels, by name."""
        return dict(self._rows("SELECT name, unit FROM channel ORDER BY id"))

    def series(self, name: str, within: Sequence[tuple[float, float]] | None = None) -> Series:
        """Return the readings of one channel; empty if it has none.

        With `within` only those in one of these spans from begin to end, so that memory does not grow with the run.
        """
        number, unit = self._channel(name)
        parts = [part if within is None else _inside(part, within) for part in self._parts(number)]
        at_s, values = np.concatenate([np.empty((0, 2)), *parts]).T.copy()
        return Series(name, unit, at_s, values)

    def envelope(self, name: str, bins: int) -> Series:
        """Return the lowest and the highest reading of a channel in each of `bins` equal times, as `envelope`.

        Up to two readings for each bin are returned unchanged.
        """
        number, unit = self._channel(name)
        count, begin_s, end_s = self._span(number)
        if count <= 2 * bins:
            return self.series(name)
        return Series(name, unit, *envelope(self._parts(number), (begin_s, end_s), bins))

    def _channel(self, name: str) -> tuple[int, str]:
        """Number and unit of a channel; 0 if there is none."""
        number, unit = next(self._rows("SELECT id, unit FROM channel WHERE name = ?", name), (0, ""))
        return number, unit

    def _span(self, number: int) -> tuple[int, float, float]:
        """Return the number of readings of a channel, and their first and last time, undefined if there are none."""
        if (kept := self._kept.get(number)) is not None and len(kept):
            return len(kept), kept[:, 0].min(), kept[:, 0].max()
        count, begin_s, end_s = next(self._rows(_SPAN_OF_READINGS, number))  # scans the whole table
        return count, begin_s, end_s

    def _parts(self, number: int) -> Iterator[NDArray[np.float64]]:
        """Yield the readings of a channel in order, times and values (n, 2); those of a short channel are kept."""
        if (kept := self._kept.get(number)) is not None:
            yield kept
            return
        parts, count = [np.empty((0, 2))], 0
        for part in self._readings(number):
            count += len(part)
            if count <= KEPT_READINGS:
                parts.append(part)
            else:
                parts.clear()
            yield part
        if count <= KEPT_READINGS:
            self._kept[number] = np.concatenate(parts)

    def _readings(self, number: int) -> Iterator[NDArray[np.float64]]:
        """Yield the readings of a channel as the database has them, times and values (n, 2)."""
        try:
            rows = self._database.execute(_READINGS, (number,))
            while len(read := np.fromiter(islice(rows, BATCH_ROWS), _READING)):
                yield read.view(np.float64).reshape(-1, 2)
        except sqlite3.Error as problem:
            raise self._unreadable(problem) from problem

    def check_chain(self) -> ChainCheck:
        """Check every row of the run against its hash chain."""
        return check_rows(self._database)

    def ignores_log(self) -> bool:
        """Return True if there is a log beside the database that SQLite ignores, as when the first page is damaged."""
        log = self.folder / database.LOG_NAME
        return log.is_file() and log.stat().st_size > 0 and next(self._rows("PRAGMA journal_mode"))[0] != "wal"

    @cached_property
    def format(self) -> int:
        """Version of the database format."""
        return int(next(self._rows("PRAGMA user_version"))[0])

    def _encoded(self, table: str, rows: list[tuple[Any, ...]]) -> bytes:
        try:
            return encoded(table, rows)
        except (TypeError, ValueError, OverflowError) as problem:
            raise StoreError(f"{self.folder}: rows of {table} are damaged ({problem})") from problem

    def digest(self) -> str:
        """Return the digest of all stored data; equal for equal runs, whatever the compression."""
        digest = Digest()
        for stream, step, frames, content in self._unpacking(content_in):
            digest.block(stream, step, frames, content)
        for table in database.TABLES.keys() - {"block"}:
            if table != "sample" or self._has_samples():
                for rows in self._batches(f"SELECT * FROM {table} ORDER BY 1"):  # noqa: S608  the names are our own
                    digest.rows(table, self._encoded(table, rows))
        return digest.hexdigest()


def _inside(part: NDArray[np.float64], spans: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Rows of times and values (n, 2) whose times are in one of the spans, which may overlap."""
    begins_s, ends_s = np.array(sorted(spans), np.float64).reshape(-1, 2).T
    reaches_s = np.concatenate([[-np.inf], np.maximum.accumulate(ends_s) + ROUNDING_S])
    begun = np.searchsorted(begins_s, part[:, 0], side="right")
    return part[part[:, 0] < reaches_s[begun]]


def digest_of(folder: Path) -> str:
    """Return the digest of a run directory."""
    with RunReader(folder) as reader:
        return reader.digest()


def _done(unpacking: tuple[str, str, int, Future[T]]) -> tuple[str, str, int, T]:
    stream, step, frames, unpacked = unpacking
    return stream, step, frames, unpacked.result()


def _made(make: Callable[[Frames], T], packed: Iterable[tuple[str, bytes, int, int]]) -> T:
    return make(_unpacked(packed))


def _unpacked(blocks: Iterable[tuple[str, bytes, int, int]]) -> Frames:
    """Join packed blocks to one block per stream."""
    collected: dict[str, list[Packed]] = {}
    for stream, data, frames, crc in blocks:
        collected.setdefault(stream, []).append(Packed(data, frames, crc))
    return {stream: unpack_all(of_stream) for stream, of_stream in collected.items()}
