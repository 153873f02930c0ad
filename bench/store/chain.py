"""The hash chain of a run: each commit adds a link, made of the link before and of the rows of that commit.

The first link, number 0, is the SHA-256 of the manifest with which the run began, so that who, what and with which
inputs is under the chain as well. A link holds how many rows each table has after its commit.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from bench.errors import StoreError
from bench.store.database import CHAIN, TABLES
from bench.store.encoded import Row, encoded

HEAD_BYTES = 32
NOTHING = dict.fromkeys(TABLES, 0)


def beginning(manifest: Path) -> bytes:
    """The head of link 0: the SHA-256 of the manifest of a run, empty where there is none."""
    return hashlib.sha256(manifest.read_bytes() if manifest.is_file() else b"").digest()


def head_after(head: bytes, of_tables: Mapping[str, bytes]) -> bytes:
    """The head that follows another by the encoded rows of a commit, by table."""
    link = hashlib.sha256(head)
    for table in TABLES:
        link.update(f"{table} {len(of_tables[table])}\n".encode())
        link.update(of_tables[table])
    return link.digest()


@dataclass(frozen=True)
class Link:
    """A row of the table `chain`: the rows that each table has after a commit, and the head."""

    number: int
    rows: Mapping[str, int]
    head: bytes

    @classmethod
    def from_row(cls, row: Row) -> Link:
        """The link in a row; ValueError for what is none."""
        number, *counts, head = row
        if not all(isinstance(count, int) for count in (number, *counts)) or not isinstance(head, bytes):
            raise ValueError("an entry of the hash chain is malformed")
        if len(head) != HEAD_BYTES:
            raise ValueError("an entry of the hash chain has no hash")
        return cls(number, dict(zip(TABLES, counts, strict=True)), head)

    def to_row(self) -> Row:
        """The row of the table."""
        return (self.number, *self.rows.values(), self.head)

    @property
    def total(self) -> int:
        """The rows of all tables."""
        return sum(self.rows.values())

    def next(self, added: Mapping[str, int], of_tables: Mapping[str, bytes]) -> Link:
        """The link of the next commit, by its number of rows and its encoded rows, both by table."""
        rows = {table: count + added[table] for table, count in self.rows.items()}
        return Link(self.number + 1, rows, head_after(self.head, of_tables))


@dataclass(frozen=True)
class Walked:
    """What a walk along a chain has found.

    `links` are those that could be read, in order; `intact` is the last one up to which everything is as written, and
    `damage` tells each range of rows that is not.
    """

    links: tuple[Link, ...]
    intact: Link | None
    damage: tuple[str, ...]


def walk(database: sqlite3.Connection) -> Walked:
    """Hold every row of a run against the chain, in one snapshot of the database."""
    try:
        database.execute("BEGIN")
        links = tuple(map(Link.from_row, database.execute(f"SELECT * FROM {CHAIN} ORDER BY number")))  # noqa: S608
        if [link.number for link in links] != list(range(len(links))) or not links or links[0].rows != NOTHING:
            raise ValueError("the entries of the hash chain are not consecutive")
        bad = [(last, link) for last, link in pairwise(links) if not _follows(database, last, link)]
        surplus = list(_surplus(database, links[-1]))
    except (sqlite3.Error, ValueError, StoreError) as problem:
        return Walked((), None, (f"the chain cannot be read ({problem})",))
    finally:
        if database.in_transaction:
            database.execute("ROLLBACK")
    intact = bad[0][0] if bad else links[-1]
    return Walked(links, intact, (*map(_range, _joined(bad)), *surplus))


def _follows(database: sqlite3.Connection, last: Link, link: Link) -> bool:
    """Whether the rows of a commit are those that its link was made of."""
    try:
        rows = {table: _between(database, table, last.rows[table], link.rows[table]) for table in TABLES}
        of_tables = {table: encoded(table, found) for table, found in rows.items()}
    except (sqlite3.Error, TypeError, ValueError, OverflowError):
        return False
    return head_after(last.head, of_tables) == link.head


def _between(database: sqlite3.Connection, table: str, after: int, to: int) -> list[Row]:
    """The rows of a table above a number up to another; ValueError unless there is each."""
    if after == to:
        return []
    query = f"SELECT * FROM {table} WHERE rowid > ? AND rowid <= ? ORDER BY rowid"  # noqa: S608  the names are our own
    rows = database.execute(query, (after, to)).fetchall()
    if [row[0] for row in rows] != list(range(after + 1, to + 1)):
        raise ValueError("rows are missing")
    return rows


def _surplus(database: sqlite3.Connection, last: Link) -> Iterator[str]:
    """Rows that no commit wrote."""
    for table, count in last.rows.items():
        query = f"SELECT COUNT(*) FROM {table} WHERE rowid > ? OR rowid < 1"  # noqa: S608  the names are our own
        if found := database.execute(query, (count,)).fetchone()[0]:
            yield f"{found} rows of {table} are beyond the last commit"


def _joined(bad: list[tuple[Link, Link]]) -> list[tuple[Link, Link]]:
    """Neighbouring commits as one range."""
    ranges: list[tuple[Link, Link]] = []
    for last, link in bad:
        if ranges and ranges[-1][1] is last:
            ranges[-1] = (ranges[-1][0], link)
        else:
            ranges.append((last, link))
    return ranges


def _range(between: tuple[Link, Link]) -> str:
    last, link = between
    ranges = [
        f"{table} {first + 1} to {link.rows[table]}" for table, first in last.rows.items() if link.rows[table] != first
    ]
    numbers = f"{last.number + 1}" if link.number == last.number + 1 else f"{last.number + 1} to {link.number}"
    return f"damaged at commit {numbers}: among the rows {', '.join(ranges) or 'of no table'}"
