"""Hash chain of a run: each commit adds a link, computed from the previous link and the rows of that commit.

Link 0 is the SHA-256 of the manifest with which the run began, so that operator, sequence and inputs are covered as
well. A link holds the number of rows of each table after its commit.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from bench.errors import StoreError
from bench.store.database import CHAIN, TABLES
from bench.store.encoded import Row, encoded

HEAD_BYTES = 32
NOTHING = dict.fromkeys(TABLES, 0)
_WITHOUT_ROWS = {table: f"{table} 0\n".encode() for table in TABLES}


def beginning(manifest: Path) -> bytes:
    """Return the head of link 0: the SHA-256 of the manifest, or of nothing if the file is missing."""
    return hashlib.sha256(manifest.read_bytes() if manifest.is_file() else b"").digest()


def head_after(head: bytes, of_tables: Mapping[str, bytes]) -> bytes:
    """Return the head that follows `head`, from the encoded rows of a commit by table; a table may be missing."""
    parts = [head]
    for table, without_rows in _WITHOUT_ROWS.items():
        if rows := of_tables.get(table):
            parts += f"{table} {len(rows)}\n".encode(), rows
        else:
            parts.append(without_rows)
    return hashlib.sha256(b"".join(parts)).digest()


class Link(NamedTuple):
    """Row of the table `chain`: number of rows of each table after a commit, and the head."""

    number: int
    rows: Mapping[str, int]
    head: bytes

    @classmethod
    def from_row(cls, row: Row) -> Link:
        """Decode a row of the table. Raises ValueError if it is malformed."""
        number, *counts, head = row
        if not all(isinstance(count, int) for count in (number, *counts)) or not isinstance(head, bytes):
            raise ValueError("an entry of the hash chain is malformed")
        if len(head) != HEAD_BYTES:
            raise ValueError("an entry of the hash chain has no hash")
        return cls(number, dict(zip(TABLES, counts, strict=True)), head)

    def to_row(self) -> Row:
        """Return the row of the table."""
        return (self.number, *self.rows.values(), self.head)

    @property
    def total(self) -> int:
        """Number of rows of all tables."""
        return sum(self.rows.values())

    def next(self, added: Mapping[str, int], of_tables: Mapping[str, bytes]) -> Link:
        """Return the link of the next commit, from its number of rows and its encoded rows, both by table."""
        rows = {**self.rows, **{table: self.rows[table] + count for table, count in added.items()}}
        return Link(self.number + 1, rows, head_after(self.head, of_tables))


class ChainCheck(NamedTuple):
    """Result of checking a run against its hash chain.

    `links` are the readable ones in order, `intact` is the last link before the first damage, and `damage` describes
    each damaged range of rows.
    """

    links: tuple[Link, ...]
    intact: Link | None
    damage: tuple[str, ...]


def check_rows(database: sqlite3.Connection) -> ChainCheck:
    """Check every row of a run against its hash chain, in one snapshot of the database."""
    try:
        database.execute("BEGIN")
        links = tuple(map(Link.from_row, database.execute(f"SELECT * FROM {CHAIN} ORDER BY number")))  # noqa: S608
        if [link.number for link in links] != list(range(len(links))) or not links or links[0].rows != NOTHING:
            raise ValueError("the entries of the hash chain are not consecutive")
        bad = [(last, link) for last, link in pairwise(links) if not _follows(database, last, link)]
        surplus = list(_surplus(database, links[-1]))
    except (sqlite3.Error, ValueError, StoreError) as problem:
        return ChainCheck((), None, (f"the chain cannot be read ({problem})",))
    finally:
        if database.in_transaction:
            database.execute("ROLLBACK")
    intact = bad[0][0] if bad else links[-1]
    return ChainCheck(links, intact, (*map(_range, _merged(bad)), *surplus))


def _follows(database: sqlite3.Connection, last: Link, link: Link) -> bool:
    """Return True if the rows of a commit match its link."""
    try:
        rows = {table: _between(database, table, last.rows[table], link.rows[table]) for table in TABLES}
        of_tables = {table: encoded(table, found) for table, found in rows.items()}
    except (sqlite3.Error, TypeError, ValueError, OverflowError):
        return False
    return head_after(last.head, of_tables) == link.head


def _between(database: sqlite3.Connection, table: str, after: int, to: int) -> list[Row]:
    """Return the rows of a table with numbers after < number <= to. Raises ValueError if one is missing."""
    if after == to:
        return []
    query = f"SELECT * FROM {table} WHERE rowid > ? AND rowid <= ? ORDER BY rowid"  # noqa: S608  the names are our own
    rows = database.execute(query, (after, to)).fetchall()
    if [row[0] for row in rows] != list(range(after + 1, to + 1)):
        raise ValueError("rows are missing")
    return rows


def _surplus(database: sqlite3.Connection, last: Link) -> Iterator[str]:
    """Yield a description of rows beyond the last commit, by table."""
    for table, count in last.rows.items():
        query = f"SELECT COUNT(*) FROM {table} WHERE rowid > ? OR rowid < 1"  # noqa: S608  the names are our own
        if found := database.execute(query, (count,)).fetchone()[0]:
            yield f"{found} rows of {table} are beyond the last commit"


def _merged(bad: list[tuple[Link, Link]]) -> list[tuple[Link, Link]]:
    """Merge neighbouring damaged commits into ranges."""
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
