"""Lowest and highest values of a long series in equal times, which a curve of a page cannot be told from."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def envelope(parts: Iterable[Array], span_s: tuple[float, float], bins: int) -> tuple[Array, Array]:
    """Times, and lowest and highest value in each of `bins` equal parts of the span; a gap in time is a NaN.

    `parts` are times and values (n, 2), one part after the other. Peaks narrower than a bin keep their height.
    """
    edges_s = np.linspace(*span_s, bins + 1)
    low, high = np.full(bins, np.inf), np.full(bins, -np.inf)
    for at_s, values in (part.T for part in parts):
        index = np.searchsorted(edges_s[:-1], at_s, side="right") - 1
        np.minimum.at(low, index, values)
        np.maximum.at(high, index, values)
    extremes = np.where(low <= high, [low, high], np.nan).T
    return np.repeat((edges_s[:-1] + edges_s[1:]) / 2, 2), extremes.ravel()
