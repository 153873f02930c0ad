"""Tables of readings: a dataclass whose fields are columns, arrays (n,)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Rows:
    """Base of such a table; a column may be None."""

    def rows(self, which: NDArray[np.int_] | NDArray[np.bool_]) -> Self:
        """A part of the table, by row numbers or by a mask."""
        columns = {column.name: getattr(self, column.name) for column in fields(self)}
        return replace(self, **{name: values[which] for name, values in columns.items() if values is not None})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The rows of several tables as one; without any it has no rows."""
        columns = {each.name: [getattr(part, each.name) for part in parts] or [np.zeros(0)] for each in fields(cls)}
        return cls(**{name: np.concatenate(column) for name, column in columns.items()})
