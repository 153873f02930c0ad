"""Visits of set points: a repeated set point is measured anew, not a correction (equations 4.3, 4.5)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array


def visits_in_order(set_c: Array, place: NDArray[np.int_]) -> NDArray[np.int_]:
    """Visit (n,) of each row, counted from 1 at each set point, from the order of the rows alone.

    `place` is the position or the rate of a row, negative if missing or without a reading. A stretch of rows at one set
    point belongs to the first visit there that has none of its places: rows that complete a visit, or were written in
    another order, begin no new one. A stretch without a place belongs to the visit before it.
    """
    visit = np.ones(len(set_c), dtype=np.int_)
    seen: dict[float, list[set[int]]] = {}
    for at_c, stretch in groupby(np.flatnonzero(np.isfinite(set_c)).tolist(), key=lambda row: float(set_c[row])):
        rows = list(stretch)
        places = set(place[rows].tolist()) - {-1}
        there = seen.setdefault(at_c, [])
        first = next((i for i, other in enumerate(there) if other.isdisjoint(places)), len(there))
        number = first if places else max(len(there) - 1, 0)
        if number == len(there):
            there.append(set())
        there[number] |= places
        visit[rows] = number + 1
    return visit


def ranked(set_c: Array, visit: Array) -> NDArray[np.int_]:
    """Visits (n,) by given numbers, renumbered from 1 at each set point; NaN is a number too."""
    rank = np.ones(len(set_c), dtype=np.int_)
    for at_c in np.unique(set_c[np.isfinite(set_c)]):
        there = set_c == at_c
        rank[there] = np.unique(visit[there], return_inverse=True)[1].ravel() + 1
    return rank


def differences(at_c: Sequence[float], values: Sequence[float], knots: tuple[Array, Array]) -> Array:
    """Differences of visits of one set point (n,) from the first of them, (n - 1,).

    They are corrected for different temperatures by the slope of the knots there: temperatures and values (k,).
    """
    knots_c, knot_values = knots
    gradient = np.gradient(knot_values, knots_c) if len(knots_c) > 1 else np.zeros_like(knot_values)
    slope = np.interp(at_c[0], knots_c, gradient) if len(knots_c) else 0.0
    return np.asarray((np.array(values[1:]) - values[0]) - slope * (np.array(at_c[1:]) - at_c[0]))
