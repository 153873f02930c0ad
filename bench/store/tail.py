"""Reading of a run while it is written: what has been added since the last call."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple, Self

from bench.errors import StoreError
from bench.store import database
from bench.store.blocks import Packed
from bench.store.reader import Event

_EVENTS = "SELECT seq, at_s, kind, step, data FROM journal WHERE seq > ? ORDER BY seq LIMIT ?"
_ENVELOPE = (
    "SELECT CAST(at_s / ? AS INTEGER) AS bucket, MIN(value), MAX(value), AVG(value) FROM reading "
    "WHERE seq >= ? AND channel = (SELECT id FROM channel WHERE name = ?) AND at_s >= ? GROUP BY bucket ORDER BY bucket"
)
_BLOCKS = """SELECT seq, stream, step, frames, first_s, last_s, crc, data FROM block WHERE last_s >= ?
  ORDER BY seq DESC LIMIT ?"""
_STEPS = """SELECT seq, at_s, kind, step, data FROM journal WHERE kind IN ('step_begins', 'step_ended', 'step_cut',
  'step_failed') AND ({any_of}) ORDER BY seq"""
_OUT_OF_ORDER_S = 60.0  # readings of several devices are written in the order of their arrival
Begins = tuple[datetime, float] | None  # instant of the begin of a run and its bench time in s; None if not known


class Bucket(NamedTuple):
    """Readings of a channel in an interval that begins at `at_s`: lowest, highest and mean."""

    at_s: float
    low: float
    high: float
    mean: float


class TailBlock(NamedTuple):
    """Block of frames of a stream as it is stored, with the step in which they arrived."""

    seq: int
    stream: str
    step: str
    frames: int
    first_s: float
    last_s: float
    crc: int
    data: bytes

    @property
    def packed(self) -> Packed:
        """The block alone."""
        return Packed(self.data, self.frames, self.crc)


class Tail:
    """Reader of one run, a context manager that is left soon: a run that ends waits for readers.

    Raises StoreError where the database cannot be read.
    """

    def __init__(self, run: Path) -> None:
        self._run = run
        self._database = database.open_to_read(run / database.FILE_NAME)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._database.close()

    def events(self, after: int = 0, limit: int = 1000) -> list[Event]:
        """Return up to `limit` entries of the journal after a number, in order."""
        rows = self._rows(_EVENTS, after, limit)
        return [Event(seq, at_s, kind, step, _data(data)) for seq, at_s, kind, step, data in rows]

    def of_kinds(self, kinds: Collection[str], limit: int) -> list[Event]:
        """Return the last `limit` entries of some kinds, newest first."""
        places = ", ".join("?" * len(kinds))
        query = f"SELECT seq, at_s, kind, step, data FROM journal WHERE kind IN ({places}) ORDER BY seq DESC LIMIT ?"  # noqa: S608  only places of values
        rows = self._rows(query, *kinds, limit)
        return [Event(seq, at_s, kind, step, _data(data)) for seq, at_s, kind, step, data in rows]

    def last_event(self) -> int:
        """Return the number of the last entry of the journal; 0 if there is none."""
        return int(self._rows("SELECT COALESCE(MAX(seq), 0) FROM journal")[0][0])

    def begins(self) -> Begins:
        """Return the instant of the begin of the run by the clock of its bench, and its bench time in s."""
        first = self.events(0, 1)
        utc = first[0].data.get("utc") if first else None
        return (datetime.fromisoformat(str(utc)), first[0].at_s) if utc else None

    def last_reading(self) -> int:
        """Return the number of the last reading; 0 if there is none."""
        return int(self._rows("SELECT COALESCE(MAX(seq), 0) FROM reading")[0][0])

    def channels(self) -> dict[str, str]:
        """Return the units of all recorded channels, by name."""
        return dict(self._rows("SELECT name, unit FROM channel ORDER BY id"))

    def span_s(self) -> tuple[float, float]:
        """Return the bench time of the first and of the last reading in s; zeros without one."""
        first, last = self._at_s("reading", "MIN"), self._at_s("reading", "MAX")
        return first or 0.0, last or 0.0

    def envelope(self, channel: str, since_s: float, width_s: float) -> list[Bucket]:
        """Return minimum, maximum and mean of a channel in intervals of a width, from the one that holds `since_s`.

        Intervals begin at multiples of their width; those without a reading are left out.
        """
        first_s = math.floor(since_s / width_s) * width_s
        rows = self._rows(_ENVELOPE, width_s, self._first_after(first_s - _OUT_OF_ORDER_S), channel, first_s)
        return [Bucket(number * width_s, low, high, mean) for number, low, high, mean in rows]

    def steps_with(self, texts: Sequence[str]) -> list[Event]:
        """Return the begins and ends of steps whose data contain one of some texts, in order."""
        rows = self._rows(_STEPS.format(any_of=" OR ".join(["instr(data, ?)"] * len(texts))), *texts)
        return [Event(seq, at_s, kind, step, _data(data)) for seq, at_s, kind, step, data in rows]

    def blocks(self, since_s: float, limit: int) -> list[TailBlock]:
        """Return the newest `limit` blocks of frames that end after an instant, in order, still packed."""
        rows = self._rows(_BLOCKS, since_s, limit)
        return [TailBlock(*row) for row in reversed(rows)]

    def _first_after(self, at_s: float) -> int:
        """Return the number of a reading before which none is newer than an instant; readings are nearly in order."""
        low, high = 1, self.last_reading() + 1
        while low < high:
            middle = (low + high) // 2
            rows = self._rows("SELECT at_s FROM reading WHERE seq >= ? ORDER BY seq LIMIT 1", middle)
            low, high = (middle + 1, high) if rows and rows[0][0] < at_s else (low, middle)
        return low

    def _at_s(self, table: str, end: str) -> float | None:
        query = f"SELECT at_s FROM {table} WHERE seq = (SELECT {end}(seq) FROM {table})"  # noqa: S608  our own names
        rows = self._rows(query)
        return float(rows[0][0]) if rows else None

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        try:
            return self._database.execute(query, values).fetchall()
        except sqlite3.Error as problem:
            raise StoreError(f"{self._run}: cannot be read ({problem})") from problem


def instant_at(begins: Begins, at_s: float | None) -> datetime | None:
    """Return the instant of a bench time by the clock of the bench; None if one of both is not known."""
    return begins[0] + timedelta(seconds=at_s - begins[1]) if begins is not None and at_s is not None else None


def _data(text: object) -> Mapping[str, Any]:
    try:
        found = json.loads(str(text))
    except (ValueError, RecursionError):
        return {"unreadable": True}
    return found if isinstance(found, dict) else {"unreadable": True}
