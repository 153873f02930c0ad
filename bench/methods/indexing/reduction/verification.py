"""Verification: readings after the calibration against the equation of their end, and its regression test (3.4).

A line through the residuals over the input has the intercept α and the slope β: by so much the equation is wrong in
bias and, relatively, in scale factor. If both together differ from 0 by more than their uncertainty explains, the line
through the readings themselves is offered as the corrected equation of that end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import fdtri

from bench.methods.indexing.reduction.budget import SCATTER, IndexingBudget
from bench.methods.indexing.reduction.estimates import IndexingEstimates
from bench.methods.indexing.reduction.readings import IndexingReading
from bench.methods.indexing.reduction.sweep import LEAST_ANGLES, SAME_ANGLE_DEG
from bench.metrology.extremes import interval_of_largest, largest_u
from bench.metrology.least_squares import Array
from bench.metrology.propagation import Estimate
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import CONFIDENCE, Finding, Subject

SELECTION = "readings: scatter makes the largest of many larger"
CERTAIN_DOF = 1e6  # degrees of freedom of a scatter that is known by itself


@dataclass(frozen=True)
class Regression:
    """Line through the residuals of one end: `offset` α in g, `scale` β, as functions of the rows of `budget`.

    `bias` and `slope` are the line through the readings themselves, the corrected equation.
    """

    end: str
    offset: Estimate
    scale: Estimate
    bias: Estimate
    slope: Estimate
    budget: IndexingBudget

    @cached_property
    def differs(self) -> bool:
        """Result of the F test of α = β = 0 at 95 %, with the covariance from all sources of the bench."""
        found = np.array([self.offset.value, self.scale.value])
        rows = self.budget.rows([self.offset, self.scale])
        size = float(found @ np.linalg.solve(rows @ rows.T, found)) / len(found)
        return size > float(fdtri(len(found), self.budget.dof or CERTAIN_DOF, CONFIDENCE))


@dataclass(frozen=True)
class Verification:
    """Readings of one unit that were not fitted, `verified`, against the lines of the ends in `estimates`."""

    subject: Subject
    estimates: IndexingEstimates
    verified: Sequence[IndexingReading]

    @cached_property
    def residuals_g(self) -> Array:
        """Residuals (g) of the readings against the equations of the ends."""
        known = [each for each in self.verified if each.end in self.estimates.fits]
        fits = [self.estimates.fits[each.end] for each in known]
        found = [(each.output - fit.bias_v) / fit.scale_v_per_g for each, fit in zip(known, fits, strict=True)]
        return np.array(found) - np.sin([each.angle_rad for each in known])

    @cached_property
    def regressions(self) -> tuple[Regression, ...]:
        """Line through the residuals of each end that was verified at enough angles."""
        return tuple(self._regressions())

    def findings(self) -> Iterator[Finding]:
        """Largest residual and root mean square, then offset and scale of the regression of each end."""
        if not len(self.residuals_g):
            return
        sd_g = self.estimates.reading_sd_g
        by_scatter, by_selection = largest_u(self.residuals_g, float(sd_g))
        dof = self.estimates.budget.dof or None
        lines = [BudgetLine(SCATTER, "A", by_scatter, dof), BudgetLine(SELECTION, "A", by_selection)]
        steps = tuple(dict.fromkeys(each.step.rsplit("/", 2)[0] for each in self.verified))
        yield self.subject.finding(
            "verification/largest", "largest residual of readings that were not fitted",
            float(np.max(np.abs(self.residuals_g))), "g", lines, {"end": "up"}, steps,
            interval=interval_of_largest(self.residuals_g, float(sd_g)),
        )  # fmt: skip
        rms = float(np.sqrt(np.mean(self.residuals_g**2)))
        line = BudgetLine(SCATTER, "A", float(sd_g) / np.sqrt(2 * len(self.residuals_g)), dof)
        yield self.subject.finding(
            "verification/rms", "root mean square of them", rms, "g", (line,), {"end": "up"}, steps
        )
        for found in self.regressions:
            for quantity, name, result, unit in (
                ("verification/offset", "bias of the equation by a line through the residuals", found.offset, "g"),
                ("verification/scale", "scale factor of the equation by it, relative", found.scale, "1"),
            ):
                lines = [*found.budget.lines(result)]
                at, tail = {"end": found.end}, f"/{found.end}"
                yield self.subject.finding(quantity, name, result.value, unit, lines, at, steps, tail)

    def _regressions(self) -> Iterator[Regression]:
        for end, fit in self.estimates.fits.items():
            here = [replace(each, kind="sweep") for each in self.verified if each.end == end]
            angle_rad = np.array([each.angle_rad for each in here])
            if len(np.unique(np.round(np.degrees(angle_rad) / SAME_ANGLE_DEG))) < LEAST_ANGLES:
                continue
            of_readings = np.linalg.pinv(np.stack([np.ones_like(angle_rad), np.sin(angle_rad)], axis=-1))
            budget = self.estimates.budget_with(end, here)
            none, scale = np.zeros((2, len(fit.dwells))), fit.scale_v_per_g
            bias, slope = of_readings @ np.array([each.output for each in here])
            line = np.hstack([none, of_readings])
            gain = np.hstack([-fit.gain, of_readings]) / scale  # of (bias - b)/G and, to first order, slope/G - 1
            yield Regression(
                end=end,
                offset=Estimate(float(bias - fit.bias_v) / scale, gain[0]),
                scale=Estimate(float(slope) / scale - 1, gain[1]),
                bias=Estimate(float(bias), line[0]),
                slope=Estimate(float(slope), line[1]),
                budget=budget,
            )
