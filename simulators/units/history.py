"""States of a unit over true time, from which the truth is told: rows of numbers, since a run has many of them."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class History:
    """Rows of `columns` numbers, the first of each its true time; they are only ever added to."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // self._columns

    def go_on(self, *columns: Array) -> None:
        """Add a row for each element of these columns."""
        self._numbers.frombytes(np.stack(columns, axis=-1).tobytes())

    @property
    def rows(self) -> Array:
        """A copy of all rows, (n, columns)."""
        return np.array(self._numbers).reshape(-1, self._columns)
