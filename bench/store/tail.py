"""Reading of a run while it is written: what has been added since the last call."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, Self

from bench.errors import StoreError
from bench.store import database
from bench.store.reader import Event

_EVENTS = "SELECT seq, at_s, kind, step, data FROM journal WHERE seq > ? ORDER BY seq LIMIT ?"
_READINGS = "SELECT seq, at_s, channel, value FROM reading WHERE seq > ? ORDER BY seq LIMIT ?"


class TailReading(NamedTuple):
    """Row of a reading: its number, bench time in s, channel and value in the unit of the channel."""

    seq: int
    at_s: float
    channel: str
    value: float


class Tail:
    """Reader of one run, a context manager that is left soon: a run that ends waits for readers.

    Raises StoreError where the database cannot be read.
    """

    def __init__(self, run: Path) -> None:
        self._run = run
        self._database = database.open_to_read(run / database.FILE_NAME)
        self._names: dict[int, str] = {}
        self.units: dict[str, str] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._database.close()

    def events(self, after: int = 0, limit: int = 1000) -> list[Event]:
        """Return up to `limit` entries of the journal after a number, in order."""
        rows = self._rows(_EVENTS, after, limit)
        return [Event(seq, at_s, kind, step, _data(data)) for seq, at_s, kind, step, data in rows]

    def last_event(self) -> int:
        """Return the number of the last entry of the journal; 0 if there is none."""
        return int(self._rows("SELECT COALESCE(MAX(seq), 0) FROM journal")[0][0])

    def begins(self) -> tuple[datetime, float] | None:
        """Return the instant of the begin of the run by the clock of its bench, and its bench time in s."""
        first = self.events(0, 1)
        utc = first[0].data.get("utc") if first else None
        return (datetime.fromisoformat(str(utc)), first[0].at_s) if utc else None

    def readings(self, after: int = 0, limit: int = 20_000) -> list[TailReading]:
        """Return up to `limit` readings after a number, in order."""
        rows = self._rows(_READINGS, after, limit)
        return [TailReading(seq, at_s, self._name(channel), value) for seq, at_s, channel, value in rows]

    def last_reading(self) -> int:
        """Return the number of the last reading; 0 if there is none."""
        return int(self._rows("SELECT COALESCE(MAX(seq), 0) FROM reading")[0][0])

    def _name(self, channel: int) -> str:
        if channel not in self._names:
            for number, name, unit in self._rows("SELECT id, name, unit FROM channel"):
                self._names[number], self.units[name] = name, unit
        return self._names[channel]

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        try:
            return self._database.execute(query, values).fetchall()
        except sqlite3.Error as problem:
            raise StoreError(f"{self._run}: cannot be read ({problem})") from problem


def _data(text: object) -> Mapping[str, Any]:
    try:
        found = json.loads(str(text))
    except (ValueError, RecursionError):
        return {"unreadable": True}
    return found if isinstance(found, dict) else {"unreadable": True}
