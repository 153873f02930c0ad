"""The digest of a run: of what it holds, however that is compressed, as it is written or read back."""

from __future__ import annotations

import hashlib

from bench.store.database import TABLES


class Digest:
    """SHA-256 of each table, fed with its rows in order, and of these; equal for equal runs.

    Each table has its own, so that a run is digested while it goes on, whichever table its next row is for.
    """

    def __init__(self) -> None:
        self._of = {table: hashlib.sha256() for table in TABLES}

    def rows(self, table: str, encoded: bytes) -> None:
        """The next rows of a table, as `encoded` makes bytes of them; not of blocks."""
        self._of[table].update(encoded)

    def block(self, stream: str, step: str, frames: int, plain: bytes) -> None:
        """The next block of frames, not compressed."""
        self._of["block"].update(repr((stream, step, frames)).encode())
        self._of["block"].update(plain)

    def hexdigest(self) -> str:
        """Of all rows until now."""
        total = hashlib.sha256()
        for table, of_table in self._of.items():
            total.update(f"{table} {of_table.hexdigest()}\n".encode())
        return total.hexdigest()
