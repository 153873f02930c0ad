"""Rows of the tables of a run as bytes, the same when they are written as when they are read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Row = tuple[Any, ...]


def encoded(table: str, rows: Sequence[Row]) -> bytes:
    """The bytes of rows of a table, their number first; raises TypeError or ValueError for what no row holds."""
    if table == "reading":  # numbers alone, and by far the most
        return np.array(rows, "<f8").tobytes() if rows else b""
    if table == "block":
        return b"".join(repr(_plain(row[:-1])).encode() + row[-1] for row in rows)
    return b"".join(repr(_plain(row)).encode() for row in rows)


def _plain(row: Row) -> list[Any]:
    """A row as it is read, whatever kind of float was written."""
    return [float(value) if isinstance(value, float) else value for value in row]
