"""Queue of a station: items in the order in which they begin. Each change is durable when its function returns."""

from __future__ import annotations

import hashlib
import json
import sqlite3
import uuid
from collections.abc import Callable, Iterable
from datetime import timedelta
from typing import Any

from bench.clock import wall_utc
from bench.errors import InputError, StaleError
from bench.station.queue.items import OCCUPYING, WAITING, Item, ItemState, Submission
from bench.station.storage.database import Database

KEYS_KEPT = timedelta(days=1)
LENGTH_LIMIT = 500  # waiting items


class Queue:
    """Items of all benches. `changed` is called after each change; raises StoreError where the disk fails."""

    def __init__(self, database: Database, changed: Callable[[Item], object] = lambda _: None) -> None:
        self._database, self.changed = database, changed

    def items(self, *states: ItemState) -> list[Item]:
        """Return the items of some states, or all, in the order in which they begin or began."""
        marks = ",".join("?" * len(states))
        where = f"WHERE state IN ({marks})" if states else ""
        rows = self._database.rows(
            f"SELECT * FROM item {where} ORDER BY priority DESC, place, number",  # noqa: S608  only question marks
            *states,
        )
        return [_item(row) for row in rows]

    def waiting(self, bench: str | None = None) -> list[Item]:
        """Return the items that have not begun, of one bench or all."""
        return [each for each in self.items(*WAITING) if bench in (None, each.submission.bench)]

    def occupying(self) -> list[Item]:
        """Return the items that are starting or running."""
        return self.items(*OCCUPYING)

    def item(self, id_: str) -> Item:
        """Return an item. Raises InputError."""
        rows = self._database.rows("SELECT * FROM item WHERE id = ?", id_)
        if not rows:
            raise InputError(f"the queue has no item '{id_}'")
        return _item(rows[0])

    def submit(
        self,
        submission: Submission,
        by: str,
        *,
        expected_s: float = 0.0,
        inputs: str = "",
        key: str = "",
        held: bool = False,
    ) -> Item:
        """Append an item; with the key of an earlier submission, return its item instead.

        Raises InputError if the key was used for another submission, or the queue is full.
        """
        now, of = wall_utc(), _digest(submission, by)
        with self._database.transaction() as database:
            if key and (known := database.execute("SELECT of, item FROM reply WHERE key = ?", (key,)).fetchone()):
                if known["of"] != of:
                    raise InputError("this idempotency key was used for another submission")
                return self.item(known["item"])
            waiting = "SELECT COUNT(*) FROM item WHERE state IN ('queued', 'held')"
            if database.execute(waiting).fetchone()[0] >= LENGTH_LIMIT:
                raise InputError(f"the queue is full: {LENGTH_LIMIT} items wait")
            number = database.execute("SELECT COALESCE(MAX(number), 0) + 1 FROM item").fetchone()[0]
            item = Item(
                id=uuid.uuid4().hex, number=number, state=ItemState.HELD if held else ItemState.QUEUED,
                priority=submission.priority, place=_last_place(database) + 1.0, submission=submission,
                submitted_by=by, submitted_at=now, expected_s=expected_s, inputs=inputs,
                held_by=by if held else "", reason=f"held by {by}" if held else "",
            )  # fmt: skip
            _insert(database, item)
            if key:
                database.execute("INSERT INTO reply VALUES (?, ?, ?, ?)", (key, of, item.id, now.isoformat()))
            database.execute("DELETE FROM reply WHERE at < ?", ((now - KEYS_KEPT).isoformat(),))
        self.changed(item)
        return item

    def hold(self, id_: str, by: str, version: int | None = None) -> Item:
        """Hold a waiting item until it is released. Raises StaleError."""
        return self.change(id_, WAITING, version, state=ItemState.HELD, held_by=by, reason=f"held by {by}")

    def release(self, id_: str, version: int | None = None) -> Item:
        """Release a held item. Raises StaleError."""
        return self.change(id_, WAITING, version, state=ItemState.QUEUED, held_by="", reason="")

    def cancel(self, id_: str, by: str, version: int | None = None) -> Item:
        """Cancel a waiting item. Raises StaleError."""
        return self.change(
            id_, WAITING, version, state=ItemState.CANCELLED, reason=f"cancelled by {by}", ended_at=wall_utc()
        )

    def move(self, id_: str, before: str | None, version: int | None = None) -> Item:
        """Move a waiting item before another one, with its priority; to the end for None. Raises StaleError."""
        with self._database.transaction() as database:
            items = {each.id: each for each in self.waiting()}
            if id_ not in items:
                raise StaleError(f"item {self.item(id_).number} does not wait any more")
            moved = items.pop(id_)
            _expect_seen(moved, version)
            others = list(items.values())
            if before is not None and before not in items:
                raise StaleError("the item to move it before does not wait any more")
            at = len(others) if before is None else others.index(items[before])
            beside = others[min(at, len(others) - 1)] if others else moved
            moved = moved.model_copy(update={"priority": beside.priority, "version": moved.version + 1})
            for place, each in enumerate([*others[:at], moved, *others[at:]]):
                _update(database, each.model_copy(update={"place": float(place)}))
        self.changed(moved)
        return self.item(id_)

    def stop(self, bench: str, reason: str) -> None:
        """Begin no further item at a bench until `go_on`."""
        with self._database.transaction() as database:
            database.execute("REPLACE INTO stopped VALUES (?, ?, ?)", (bench, reason, wall_utc().isoformat()))

    def go_on(self, bench: str) -> None:
        """Begin items at a bench again."""
        with self._database.transaction() as database:
            database.execute("DELETE FROM stopped WHERE bench = ?", (bench,))

    def stopped(self, bench: str) -> str:
        """Return why no item begins at a bench; "" if items begin."""
        return self.stop_of(bench)[0]

    def stop_of(self, bench: str) -> tuple[str, str]:
        """Return why no item begins at a bench, and since when; twice "" if items begin."""
        rows = self._database.rows("SELECT reason, at FROM stopped WHERE bench = ?", bench)
        return (str(rows[0]["reason"]), str(rows[0]["at"])) if rows else ("", "")

    def change(self, id_: str, expected: Iterable[ItemState], version: int | None = None, **changes: Any) -> Item:
        """Change an item in one of the expected states. Raises InputError, and StaleError if it is in another.

        `version` is that of the item which the caller has seen; None for any.
        """
        with self._database.transaction() as database:
            found = self.item(id_)
            if found.state not in expected:
                raise StaleError(f"item {found.number} is {found.state}")
            _expect_seen(found, version)
            item = found.model_copy(update={**changes, "version": found.version + 1})
            _update(database, item)
        self.changed(item)
        return item


def _expect_seen(item: Item, version: int | None) -> None:
    """Raise StaleError if an item is no longer as its sender has seen it."""
    if version is not None and version != item.version:
        raise StaleError(f"item {item.number} has changed meanwhile; look at it again")


def _last_place(database: sqlite3.Connection) -> float:
    return float(database.execute("SELECT COALESCE(MAX(place), 0) FROM item").fetchone()[0])


def _digest(submission: Submission, by: str) -> str:
    return hashlib.sha256(f"{by}\n{submission.model_dump_json()}".encode()).hexdigest()


def _insert(database: sqlite3.Connection, item: Item) -> None:
    database.execute("INSERT INTO item VALUES (?, ?, ?, ?, ?, ?, ?, ?)", _row(item))


def _update(database: sqlite3.Connection, item: Item) -> None:
    database.execute("REPLACE INTO item VALUES (?, ?, ?, ?, ?, ?, ?, ?)", _row(item))


def _row(item: Item) -> tuple[object, ...]:
    data = item.model_dump_json()
    return item.id, item.number, item.submission.bench, item.state, item.priority, item.place, item.version, data


def _item(row: sqlite3.Row) -> Item:
    return Item.model_validate(json.loads(row["data"]))
