"""Encoding of table rows as bytes, identical when written and when read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Row = tuple[Any, ...]


def encoded(table: str, rows: Sequence[Row]) -> bytes:
    """Encode rows of a table. Raises TypeError or ValueError for values that the table cannot hold.

    Their values are those that SQLite returns: floats of Python, for example, and not of NumPy.
    """
    if not rows:
        return b""
    if table == "reading":  # by far the most frequent table, and numeric
        return np.array(rows, "<f8").tobytes()
    if table == "block":
        return b"".join([repr(list(row[:-1])).encode() + row[-1] for row in rows])
    return "".join([repr(list(row)) for row in rows]).encode()
