"""Audit of a station: who did what, when and why, in a chain that shows every later change."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from bench.clock import wall_utc
from bench.station.database import Database

BEGINNING = "0" * 64


class Sender(Protocol):
    """Person or program that acts: its name, and how it was identified, with an identifier."""

    @property
    def name(self) -> str:
        """Name."""

    @property
    def how(self) -> str:
        """How it was identified, such as a session or a token."""

    @property
    def id(self) -> str:
        """Identifier of the token; may be empty."""


class Audit:
    """Entries in the order in which they were written; none is ever changed. Raises StoreError."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def note(self, sender: Sender, action: str, of: str = "", **facts: Any) -> None:
        """Append an entry, durably: an action by a sender on an object, with facts such as `before` and `after`."""
        entry = {"who": sender.name, "how": sender.how, "id": sender.id, "action": action, "of": of, **facts}
        at, data = wall_utc().isoformat(), json.dumps(entry, ensure_ascii=False, sort_keys=True, default=str)
        with self._database.transaction() as tables:
            last = tables.execute("SELECT head FROM audit ORDER BY number DESC LIMIT 1").fetchone()
            head = _head(last["head"] if last else BEGINNING, at, data)
            tables.execute("INSERT INTO audit(at, data, head) VALUES (?, ?, ?)", (at, data, head))

    def entries(self, after: int = 0, limit: int = 500) -> Iterator[Mapping[str, Any]]:
        """Yield entries after a number, each with `number` and `at`."""
        for row in self._database.rows("SELECT * FROM audit WHERE number > ? ORDER BY number LIMIT ?", after, limit):
            yield {"number": row["number"], "at": row["at"], **json.loads(row["data"])}

    def first_wrong(self) -> int | None:
        """Return the number of the first entry that does not continue the chain; None if all do."""
        head = BEGINNING
        for expected, row in enumerate(self._database.rows("SELECT * FROM audit ORDER BY number"), 1):
            head = _head(head, row["at"], row["data"])
            if row["number"] != expected or row["head"] != head:
                return int(row["number"])
        return None


def _head(before: str, at: str, data: str) -> str:
    return hashlib.sha256(f"{before}\n{at}\n{data}".encode()).hexdigest()
