"""Scatter by two estimates: residuals of a fit, often with few degrees of freedom, and the readings themselves."""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum, log, sqrt
from typing import NamedTuple

import scipy

SIGNIFICANT = 0.95  # quantile below which scatters differ by chance


class Scatter(NamedTuple):
    """A standard deviation, with its degrees of freedom."""

    sd: float
    dof: int


def pooled(left: Scatter, of_readings: Scatter) -> Scatter | None:
    """Scatter by both together; None if the residuals of the fit significantly exceed the scatter of its readings."""
    if not of_readings.dof or not of_readings.sd:
        return None
    if scipy.special.fdtr(left.dof, of_readings.dof, (left.sd / of_readings.sd) ** 2) > SIGNIFICANT:
        return None
    return _together((left, of_readings))


def alike(scatters: Sequence[Scatter]) -> Scatter | None:
    """Common scatter of all if they differ by chance only, else None (M.

    S. Bartlett, Proc. R. Soc. A 160, 268, 1937).
    """
    if len(scatters) < 2 or not all(each.sd > 0 and each.dof > 0 for each in scatters):
        return None
    together = _together(scatters)
    apart = fsum(each.dof * log((together.sd / each.sd) ** 2) for each in scatters)
    few = 1 + (fsum(1 / each.dof for each in scatters) - 1 / together.dof) / (3 * (len(scatters) - 1))
    return together if scipy.special.chdtr(len(scatters) - 1, apart / few) <= SIGNIFICANT else None


def _together(scatters: Sequence[Scatter]) -> Scatter:
    dof = sum(each.dof for each in scatters)
    return Scatter(sqrt(fsum(each.dof * each.sd**2 for each in scatters) / dof), dof)
