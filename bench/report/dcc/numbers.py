"""Results in units of the SI. Those in units of local gravity are converted by that of the site."""

from __future__ import annotations

import math

from bench.certificates import dsi
from bench.config.models import Gravity
from bench.metrology.results.coverage import coverage_factor, effective_dof
from bench.metrology.results.finding import Finding
from bench.report.dcc.elements import Number


def scale(unit: str, gravity: Gravity) -> tuple[float, str]:
    """Return the factor from a unit of this project to one of D-SI, and that unit."""
    known = dsi.written(unit)
    return float(known.factor) * gravity.value**known.gravity, known.text


def converted(finding: Finding, gravity: Gravity) -> Number:
    """Return a result in D-SI.

    The uncertainty of local gravity is added to that of a result in units of it, and the coverage factor is that of
    the degrees of freedom of both.
    """
    factor, unit = scale(finding.unit, gravity)
    power = dsi.written(finding.unit).gravity
    value, u, dof, k, interval = (
        factor * finding.value,
        abs(factor) * finding.u,
        finding.dof,
        finding.k,
        finding.interval,
    )
    if power and u:
        of_gravity = abs(power * value) * gravity.U / gravity.k / gravity.value
        dof = effective_dof([(u, dof), (of_gravity, None)])
        interval = None if interval is None else interval.beside(of_gravity / abs(factor))
        u, k = math.hypot(u, of_gravity), coverage_factor(dof)
    sides = None if interval is None else (factor * interval.low, factor * interval.high)
    return Number(value, unit, u, k, dof, sides)


def as_reported(finding: Finding) -> Number:
    """Return a result in units of local gravity as it is in the report, g being 1."""
    unit = dsi.written(finding.unit, g_is_one=True)
    factor = float(unit.factor)
    interval = None if finding.interval is None else (factor * finding.interval.low, factor * finding.interval.high)
    return Number(factor * finding.value, unit.text, factor * finding.u, finding.k, finding.dof, interval)
