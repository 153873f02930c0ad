"""Digest of the data of a run: independent of compression, equal when written and when read back."""

from __future__ import annotations

import hashlib

from bench.store.blocks import Content
from bench.store.database import TABLES


class Digest:
    """SHA-256 over the SHA-256 of each table, fed row by row.

    Each table has its own hash, so that rows of all tables can arrive in any interleaving while the run goes on.
    """

    def __init__(self) -> None:
        self._of = {table: hashlib.sha256() for table in TABLES}

    def rows(self, table: str, encoded: bytes) -> None:
        """Add the next rows of a table, as bytes from `encoded`; for the table of blocks use `block`."""
        self._of[table].update(encoded)

    def block(self, stream: str, step: str, frames: int, content: Content) -> None:
        """Add the next block of frames."""
        self._of["block"].update(repr((stream, step, frames)).encode())
        self._of["block"].update(content.plain)

    def hexdigest(self) -> str:
        """Return the digest of all rows so far."""
        total = hashlib.sha256()
        for table, of_table in self._of.items():
            total.update(f"{table} {of_table.hexdigest()}\n".encode())
        return total.hexdigest()
