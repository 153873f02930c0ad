"""States of a unit over true time, from which the truth is told: rows of numbers in a file, since a run has many."""

from __future__ import annotations

import os
import weakref
from array import array
from bisect import bisect_right
from tempfile import SpooledTemporaryFile

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PAGE = 256  # rows; the time of the first of each is in memory
IN_MEMORY_BYTES = 1 << 20  # a short run needs no file


class History:
    """Rows of `columns` numbers, the first of each its true time; they are only ever added to.

    Rows of several observers may be out of order by less than a page. Lifetime: its file is removed with it.
    """

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._rows = 0
        self._begins_s = array("d")  # of each page
        self._file = SpooledTemporaryFile(IN_MEMORY_BYTES)  # noqa: SIM115  open as long as the history
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return self._rows

    def go_on(self, *columns: Array) -> None:
        """Add a row for each element of these columns."""
        self.add(np.stack(columns, axis=-1))

    def add(self, rows: Array) -> None:
        """Add rows (n, columns)."""
        self._begins_s.extend(rows[-self._rows % PAGE :: PAGE, 0].tolist())
        self._rows += len(rows)
        self._file.write(rows.tobytes())

    def around(self, begin_s: float, end_s: float) -> Array:
        """Rows (n, columns) of whole pages: all between two times, and those before and after them."""
        first, last = (bisect_right(self._begins_s, at_s) for at_s in (begin_s, end_s))
        return self._read(max(first - 2, 0) * PAGE, (last + 1) * PAGE)

    @property
    def rows(self) -> Array:
        """A copy of all rows, (n, columns)."""
        return self._read(0, self._rows)

    def _read(self, begin: int, end: int) -> Array:
        row_bytes = self._columns * array("d").itemsize
        self._file.seek(begin * row_bytes)
        data = self._file.read((end - begin) * row_bytes)
        self._file.seek(0, os.SEEK_END)
        return np.frombuffer(data).reshape(-1, self._columns)
