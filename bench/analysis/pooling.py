"""Scatter that is told twice: by what a fit leaves, of which there is often little, and by the readings themselves."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from scipy.special import fdtr

SIGNIFICANT = 0.95  # of the distribution of F under which a fit leaves no more than the readings' scatter


class Scatter(NamedTuple):
    """A standard deviation, with its degrees of freedom."""

    sd: float
    dof: int


def pooled(left: Scatter, of_readings: Scatter) -> Scatter | None:
    """The scatter by both together; None where the fit leaves significantly more than its readings scatter by."""
    if not of_readings.dof or not of_readings.sd:
        return None
    if fdtr(left.dof, of_readings.dof, (left.sd / of_readings.sd) ** 2) > SIGNIFICANT:
        return None
    dof = left.dof + of_readings.dof
    return Scatter(sqrt((left.dof * left.sd**2 + of_readings.dof * of_readings.sd**2) / dof), dof)
