"""Uncertainty of the results of a temperature ramp.

A result in g is an output / K1, and K1 contains the misalignment of the input axis as an error. Two positions do not
separate it from the bias, so that its prior uncertainty is in the budgets. An offset of the thermometer shifts all
temperatures and no result, its gain affects slopes only; its drift within the run, and that of the level, affect all
differences over time. The lag behind the thermometer, and the unit's response to the rate itself, are part of the loop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bench.methods.ramp.reduction.characteristic import UG_PER_G, Differences
from bench.methods.ramp.reduction.reduced import ReducedRamp
from bench.methods.ramp.reduction.samples import RampLeg
from bench.methods.ramp.reduction.scatter import (
    COUNT_STRIDE,
    SlopeScatter,
    resolution_u,
    shown_scatter,
    slope_scatter,
    sum_scatter,
)
from bench.metrology.extremes import scatter_sd
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.finding import Subject
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun, source_of

SCATTER = "samples: scatter"
COUNTING = "counting"  # the kind of the line of the resolution of the count
LAG = "lag behind the thermometer, and the unit's response to the rate: contained"
LEVEL = "fixture: level"


@dataclass(frozen=True)
class RampBudget:
    """Sources of uncertainty of the results of one unit."""

    data: RunData
    unit: UnitUnderTest
    ramp: ReducedRamp
    misalignment_u_rad: float

    @property
    def subject(self) -> Subject:
        """Unit and label of the findings."""
        return self.data.subject(self.unit)

    # Scatter

    @cached_property
    def sd_g(self) -> float:
        """Standard deviation of a sample about a smooth curve."""
        smooth = [residuals_ug / UG_PER_G for residuals_ug in self.ramp.found.residuals_ug]
        found = _known_sd(scatter_sd(smooth, COUNT_STRIDE), self.ramp.found.line.residual_sd)
        return shown_scatter(found, resolution_u(self.ramp.whole) * self.ramp.per_g)

    def sds_of(self, differences: Sequence[Differences]) -> list[Array]:
        """Standard deviations (n,) of the differences between two legs about a smooth curve, in g."""
        gains = [each.gain for each in differences]
        sd_g = scatter_sd([each.ug / UG_PER_G for each in differences], COUNT_STRIDE, gains)
        return [_known_sd(sd_g, self.sd_g) * gain for gain in gains]

    def scatter_of_slope(self) -> list[BudgetLine]:
        """Scatter contribution to the slope of the bias, in g/°C."""
        found = slope_scatter(self.ramp.level)
        if found is None:
            u = self.sd_g * _slope_gain(self.ramp.level)
            return [BudgetLine(SCATTER, "A", u, self.ramp.found.line.dof or None)]
        return _scatter_lines(found, self.ramp.per_g)

    def scatter_of_rms(self) -> list[BudgetLine]:
        """Scatter contribution to the root mean square of the residuals, in g: the correlated part."""
        found, rms_g = self.ramp.found, self.ramp.found.rms_residual_ug / UG_PER_G
        count = len(found.line.residuals)
        known = {
            (leg.cycle, leg.name): (leg.time_s, ug / UG_PER_G)
            for leg, ug in zip(found.legs, found.residuals_ug, strict=True)
        }
        gains = [_at_times(leg, *known[leg.cycle, leg.name]) / (count * (rms_g or 1.0)) for leg in self.ramp.level]
        scatter = sum_scatter(self.ramp.level, gains)
        if scatter is None:
            return [BudgetLine(SCATTER, "A", self.sd_g / float(np.sqrt(count)))]
        return _scatter_lines(scatter, self.ramp.per_g)

    def scatter_of_scale_slope(self) -> list[BudgetLine]:
        """Scatter contribution to the slope of the scale factor, relative to it, in 1/°C."""
        at_0g, at_1g = slope_scatter(self.ramp.whole), slope_scatter(self.ramp.upright)
        if at_0g is not None and at_1g is not None:
            return _scatter_lines(at_1g.together(at_0g), self.ramp.per_g)
        line = self.ramp.scale.line
        sd = _known_sd(scatter_sd([_finite(leg.output) for leg in self.ramp.upright], COUNT_STRIDE), line.residual_sd)
        gains = sd * self.ramp.per_g * _slope_gain(self.ramp.upright), self.sd_g * _slope_gain(self.ramp.whole)
        return [BudgetLine(SCATTER, "A", float(np.hypot(*gains)), line.dof or None)]

    # What changes within the run

    def thermometer(self, slope: float) -> BudgetLine:
        """Contribution of the gain of the thermometer to a slope."""
        _, gain = self.data.bench.thermometer_u(self.unit.temperature)
        return BudgetLine(f"{self.unit.temperature}: gain", "B", abs(slope) * gain, None, self.unit.temperature)

    def drifts(self, figure: Callable[[ReducedRamp], float]) -> list[BudgetLine]:
        """Contributions to a result of the ramp from a thermometer and a level that drift within the run."""
        as_found, of_level = figure(self.ramp), source_of(LEVEL, self.data.bench.level_drift)
        by_level = abs(figure(self._tilted) - as_found)
        by_thermometer = self._drift.line(figure(self._drifted) - as_found)
        return [by_thermometer, common(of_level, by_level)]

    @property
    def _drift(self) -> DriftInRun:
        return DriftInRun(self.data, self.unit.temperature)

    @cached_property
    def _drifted(self) -> ReducedRamp:
        return self.ramp.drifted(self._drift)

    @cached_property
    def _tilted(self) -> ReducedRamp:
        u_rad = np.radians(self.data.bench.level_drift.u)
        return self.ramp.tilted(lambda at_s: self.data.run_share(at_s) * u_rad)

    # The scale factor

    def scale_error(self, value_g: float) -> BudgetLine:
        """Contribution of the misalignment in K1; its relative error equals the misalignment in rad."""
        return BudgetLine(
            "K1: misalignment in it", "B", abs(value_g) * self.misalignment_u_rad, None, self.subject.id("K1")
        )

    def scale_left(self, factor: float = 1.0) -> BudgetLine:
        """Contribution of the unmodelled part of K1 over temperature, on the output at 0 g of a head off the level.

        Residuals of the polynomials of K1 in the 1 g part, beyond scatter, are an error of K1 that depends on
        temperature; 1° off the level it acts on 17 mg. Between two cycles it cancels.
        """
        ramp = self.ramp
        scatter = _known_sd(scatter_sd([_finite(leg.output) for leg in ramp.upright], COUNT_STRIDE), 0.0) * ramp.per_g
        left = float(np.sqrt(max(ramp.scale.left**2 - scatter**2, 0.0)))
        read_g = float(np.mean([np.nanmean(leg.output) for leg in ramp.level])) * ramp.per_g
        return BudgetLine("K1: what its polynomial leaves", "B", float(factor * abs(read_g) * left))

    def bias_slope_change(self) -> BudgetLine:
        """Contribution of changes of the bias to the slope of K1, in 1/°C, beyond scatter; 0 with one cycle.

        Only the slope of a change affects the slope of K1. If the slopes of the cycles are independent, with the
        standard deviation s, the mean of n cycles at 1 g minus that of n at 0 g has s √(2/n), and two cycles differ by
        s √2.
        """
        squares = []
        for each, sd_g in zip(self.ramp.changes, self.sds_of(self.ramp.changes), strict=True):
            away_c = each.temperature_c - np.mean(each.temperature_c)
            if spread := float(np.sum(away_c**2)):
                by_scatter = float(np.sum((away_c * sd_g) ** 2))
                squares.append(((float(away_c @ each.ug) / UG_PER_G) ** 2 - by_scatter) / spread**2)
        cycles = len({leg.cycle for leg in self.ramp.level})
        u = float(np.sqrt(max(np.mean(squares) if squares else 0.0, 0.0) / cycles))
        return BudgetLine("bias: its change between the 0 g part and the 1 g part", "B", u)


def _scatter_lines(found: SlopeScatter, scale: float) -> list[BudgetLine]:
    counting = (
        [BudgetLine("samples: resolution of the count", "B", found.counted * scale, kind=COUNTING)]
        if found.counted
        else []
    )
    return [*counting, BudgetLine(SCATTER, "A", found.own * scale, found.dof)]


def _at_times(leg: RampLeg, time_s: Array, values: Array) -> Array:
    """Values at the times of the usable samples of a leg; 0 at the others."""
    usable_s = leg.time_s[np.isfinite(leg.output) & np.isfinite(leg.temperature_c)]
    found = np.zeros(len(usable_s))
    found[np.isin(usable_s, time_s)] = values[np.isin(time_s, usable_s)]
    return found


def _known_sd(sd: float, otherwise: float) -> float:
    """A standard deviation, or the alternative if there were too few values."""
    return float(sd if np.isfinite(sd) else otherwise if np.isfinite(otherwise) else 0.0)


def _slope_gain(legs: Sequence[RampLeg]) -> float:
    """Standard uncertainty of the slope of a straight line through samples with a standard deviation of 1, in 1/°C."""
    temperature_c = np.concatenate([_finite(leg.temperature_c) for leg in legs])
    return 1 / (float(np.std(temperature_c)) * float(np.sqrt(len(temperature_c))))


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]
