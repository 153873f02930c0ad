"""Audit of a station: who did what, when and why, in a chain that shows every later change.

Its heads are also in the ledger of the user, outside the folder of the station, so that a chain cut short is found.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from bench.clock import wall_utc
from bench.errors import StoreError
from bench.station.storage.database import Database
from bench.store import ledger
from bench.store.chain import Link

BEGINNING = "0" * 64
OWED_MOST = 1000


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

    @property
    def address(self) -> str:
        """Address that the request came from; may be empty."""


class Audit:
    """Entries in the order in which they were written; none is ever changed. Raises StoreError."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._ledger = f"audit {hashlib.sha256(str(database.path.resolve()).encode()).hexdigest()[:16]}"
        self._owed: list[tuple[str, str]] = []  # instants and entries that could not be written

    def note(self, sender: Sender, action: str, of: str = "", **facts: Any) -> None:
        """Append an entry, durably: an action by a sender on an object, with facts such as `before` and `after`."""
        with self._database.transaction():
            for at, data in self._owed:
                self._append(at, data)
            self._append(*_entry(sender, action, of, facts))
            self._database.after_commit(self._owed.clear)

    @contextmanager
    def noted(self, sender: Sender, action: str, of: str = "", **facts: Any) -> Iterator[dict[str, Any]]:
        """Make the changes of the block and their entry durable together, or neither. More facts may be added."""
        with self._database.transaction():
            yield facts
            self.note(sender, action, of, **facts)

    def note_afterwards(self, sender: Sender, action: str, of: str = "", **facts: Any) -> str:
        """Append the entry of an action that is complete; return why it is not written yet, or ""."""
        try:
            self.note(sender, action, of, **facts)
        except StoreError as problem:
            self._owed = [*self._owed, _entry(sender, action, of, facts)][-OWED_MOST:]
            return str(problem)
        return ""

    def entries(self, after: int = 0, limit: int = 500) -> Iterator[Mapping[str, Any]]:
        """Yield entries after a number, each with `number` and `at`."""
        for number, at, data, _ in self._rows("WHERE number > ? ORDER BY number LIMIT ?", after, limit):
            try:
                entry = dict(json.loads(data))
            except (ValueError, TypeError):  # somebody has changed it
                entry = {"unreadable": data.encode(errors="replace").decode()}
            yield {**entry, "number": number, "at": at}

    def first_wrong(self) -> int | None:
        """Return the number of the first entry that does not continue the chain, or is missing; None if all do."""
        head, number, heads = BEGINNING, 0, {0: BEGINNING}
        for number, (given, at, data, kept) in enumerate(self._rows("ORDER BY number"), 1):
            head = _head(head, at, data)
            if given != number or kept != head:
                return number
            heads[number] = head
        with suppress(OSError):
            for noted in ledger.entries_of(self._ledger):
                if heads.get(noted.number) != noted.head:
                    return min(noted.number, number + 1)
        return None

    def _rows(self, where: str, *values: object) -> Iterator[tuple[int, str, str, str]]:
        """Yield number, instant, entry and head, whatever somebody has made of them."""
        columns = "number, CAST(at AS BLOB), CAST(data AS BLOB), CAST(head AS BLOB)"
        for row in self._database.rows(f"SELECT {columns} FROM audit {where}", *values):  # noqa: S608  our own words
            at, data, head = ((each or b"").decode("utf-8", "surrogateescape") for each in tuple(row)[1:])
            yield row[0], at, data, head

    def _append(self, at: str, data: str) -> None:
        with self._database.transaction() as tables:
            last = tables.execute("SELECT number, head FROM audit ORDER BY number DESC LIMIT 1").fetchone()
            number, head = (last["number"] + 1, last["head"]) if last else (1, BEGINNING)
            head = _head(head, at, data)
            tables.execute("INSERT INTO audit VALUES (?, ?, ?, ?)", (number, at, data, head))
        self._database.after_commit(lambda: self._keep_outside(number, head))

    def _keep_outside(self, number: int, head: str) -> None:
        with suppress(OSError):
            ledger.note(self._ledger, bytes.fromhex(BEGINNING), Link(number, {"audit": number}, bytes.fromhex(head)))


def _entry(sender: Sender, action: str, of: str, facts: Mapping[str, Any]) -> tuple[str, str]:
    """Return the instant and the text of an entry; facts without a content are left out."""
    given = {name: fact for name, fact in facts.items() if fact not in ("", None)}
    who = {"who": sender.name, "how": sender.how, "id": sender.id, "address": sender.address}
    entry = {**given, **who, "action": action, "of": of}
    return wall_utc().isoformat(), json.dumps(entry, ensure_ascii=False, sort_keys=True, default=str)


def _head(before: str, at: str, data: str) -> str:
    return hashlib.sha256(f"{before}\n{at}\n{data}".encode("utf-8", "surrogateescape")).hexdigest()
