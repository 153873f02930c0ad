"""Encoding of table rows as bytes, identical when written and when read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Row = tuple[Any, ...]


def encoded(table: str, rows: Sequence[Row]) -> bytes:
    """Encode rows of a table. Raises TypeError or ValueError for values that the table cannot hold."""
    if not rows:
        return b""
    if table == "reading":  # by far the most frequent table, and numeric
        return np.array(rows, "<f8").tobytes()
    if table == "block":
        return b"".join(repr(_plain(row[:-1])).encode() + row[-1] for row in rows)
    return b"".join(repr(_plain(row)).encode() for row in rows)


def _plain(row: Row) -> list[Any]:
    """Convert NumPy floats to Python floats, as SQLite returns them."""
    return [float(value) if isinstance(value, float) else value for value in row]
