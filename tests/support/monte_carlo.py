"""Trials after GUM supplement 1 (JCGM 101): the scatter of results beside the uncertainties that they state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
import pytest

from bench.metrology.results.finding import Finding, UnitResult

WITHIN = 0.1  # of the uncertainty, that the scatter may be beside it
FAR = 0.15  # an uncertainty that is so far off must be seen

Rows = Mapping[str, np.ndarray]


def found_in(
    results: Iterable[tuple[UnitResult, Mapping[str, Callable[[Finding], float]]]],
    u_of: Callable[[Finding, UnitResult], float] = lambda found, _: found.u,
) -> Rows:
    """Errors and uncertainties by quantity, (n, 2), of every finding of results that has a truth beside it."""
    rows: dict[str, list[tuple[float, float]]] = {}
    for result, truth in results:
        for found in result.findings:
            if found.quantity in truth:
                error = found.value - truth[found.quantity](found)
                rows.setdefault(found.quantity, []).append((error, u_of(found, result)))
    return {quantity: np.array(each) for quantity, each in rows.items()}


def scatter_is_u(rows: np.ndarray) -> bool:
    """Return whether errors are as large as uncertainties say, in the root mean square over (n, 2)."""
    scatter, u = np.sqrt(np.mean(rows**2, axis=0))
    return bool(scatter == pytest.approx(u, rel=WITHIN))


def would_be_seen(rows: np.ndarray) -> bool:
    """Return whether the same trial fails when all uncertainties are stated too large or too small."""
    return not any(scatter_is_u(rows * (1.0, factor)) for factor in (1 - FAR, 1 + FAR))


def ratio(rows: np.ndarray) -> float:
    """Scatter over uncertainty, for a message."""
    scatter, u = np.sqrt(np.mean(rows**2, axis=0))
    return float(scatter / u)
