"""Readings of instruments that need the corrections of their certificates.

A table holds readings and the corrections to be added to them; beyond its ends the end values apply.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Table = tuple[tuple[float, ...], tuple[float, ...]]
TURN_DEG = 360.0


def read_of(right: Array, table: Table) -> Array:
    """Reading that is right after the correction of the table has been added; without a table the true value."""
    if not table[0]:
        return right
    readings, to_add = (np.array(column) for column in table)
    return np.asarray(right - np.interp(right, readings + to_add, to_add))


def correction_deg(angle_deg: Array, table: Table) -> Array:
    """Correction of encoder angles by a table of one turn."""
    readings, to_add = table
    return np.interp(readings[0] + (angle_deg - readings[0]) % TURN_DEG, readings, to_add)


def corrected_current(indicated: float, table: Table) -> float:
    """True current of a source with this indicated current; equal without a table."""
    readings, to_add = table
    return indicated + float(np.interp(indicated, readings, to_add)) if readings else indicated
