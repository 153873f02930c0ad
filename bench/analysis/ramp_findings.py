"""The findings of a temperature ramp, each with its budget.

A figure in g is an output over K1, and K1 holds the misalignment of the input axis as an error. Two positions do not
tell it from the bias, so that what is known of it before stands in the budgets. An offset of the thermometer moves all
temperatures alike and no figure here, its gain moves slopes only; what lags behind it, and what the unit makes of the
rate itself, is part of the loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bench.analysis.compensation import Compensation
from bench.analysis.extremes import interval_of_largest, interval_of_rms, largest_u, scatter_sd
from bench.analysis.finding import BudgetLine, Finding, Interval, Subject
from bench.analysis.fit import Array, PolynomialFit
from bench.analysis.models import TemperatureModel
from bench.analysis.ramp_samples import RampLeg
from bench.analysis.ramp_scale import RampScale
from bench.analysis.ramp_scatter import SlopeScatter, slope_scatter
from bench.analysis.rundata import RunData, UnitUnderTest
from bench.analysis.temperature_dynamic import UG_PER_G, Differences, DynamicCharacteristic, RampJump, RampLimits
from bench.analysis.tilt_findings import TiltOrigin, tilt_findings

SCATTER = "samples: scatter"
COUNTING = "samples: resolution of the count"
SELECTION = "samples: scatter makes the largest of many larger"
LAG = "lag behind the thermometer, and the unit's response to the rate: contained"
COUNT_STRIDE = 2  # neighbours share a latch, and so the error of a count


@dataclass(frozen=True)
class RampFindings:
    """The results of one unit: of its legs at 0 g and at 1 g, its scale factor, and what the legs at 0 g do.

    The slope of the scale factor is of `whole` legs at 0 g and of those at 1 g, and so are `changes`; `level` and
    `found` are without turn-rounds.
    """

    data: RunData
    unit: UnitUnderTest
    level: Sequence[RampLeg]
    whole: Sequence[RampLeg]
    upright: Sequence[RampLeg]
    scale: RampScale
    found: DynamicCharacteristic
    changes: Sequence[Differences]
    limits: RampLimits
    misalignment_u_rad: float

    def findings(self) -> Iterator[Finding]:
        """Everything that a limit may name, and each jump."""
        yield self._slope()
        yield from self._residuals()
        yield from self._differences()
        yield from self._jumps()
        yield from self._lag()
        yield self._scale_slope()
        yield from self._tilt()

    def models(self, left_out: tuple[str, ...]) -> Iterator[TemperatureModel]:
        """The straight line of the bias, misalignment included, and the scale factor."""
        yield self._model("K0", "g", self.found.line, len(self.level), left_out)
        yield self._model("K1", f"{self.unit.output_unit}/g", self.scale.model, len(self.upright), left_out)

    def compensation(self) -> Compensation:
        """How an output becomes an acceleration; the bias has the misalignment at 0 g in it."""
        bias, scale = self.models(())
        return Compensation(self.unit.measured_by, self.unit.output_unit, "g", scale=scale, bias=bias)

    # The straight line and what departs from it

    def _slope(self) -> Finding:
        line = self.found.line
        slope = float(line.coefficients[1]) / line.scale
        at = {"temperature_c": line.centre}
        lines = [*self._scatter_of_slope(), self._thermometer(slope), self._scale_error(slope)]
        name = "slope of the straight line over temperature"
        return self._finding("K0/temperature_coefficient", name, slope, "g/°C", lines, at)

    def _residuals(self) -> Iterator[Finding]:
        found, sd_g = self.found, self._sd_g()
        residuals_g = found.line.residuals
        by_scatter, by_selection = largest_u(residuals_g, sd_g)
        largest_g = found.max_residual_ug / UG_PER_G
        lines = [
            BudgetLine(SCATTER, "A", by_scatter), BudgetLine(SELECTION, "A", by_selection),
            self._scale_error(largest_g), self._scale_left(), BudgetLine(LAG, "alias", 0.0),
        ]  # fmt: skip
        yield self._finding(
            "K0/model_residual", "largest residual of the straight line", largest_g, "g", lines, self._at_largest(),
            interval=interval_of_largest(residuals_g, sd_g),
        )  # fmt: skip
        rms_g = found.rms_residual_ug / UG_PER_G
        added_g = rms_g - float(np.sqrt(max(rms_g**2 - sd_g**2, 0.0)))
        lines = [
            BudgetLine(SCATTER, "A", sd_g / np.sqrt(len(residuals_g))),
            BudgetLine("samples: scatter is part of it", "A", added_g),
            self._scale_error(rms_g), self._scale_left(), BudgetLine(LAG, "alias", 0.0),
        ]  # fmt: skip
        yield self._finding(
            "K0/model_residual_rms", "root mean square of the residuals", rms_g, "g", lines, {},
            interval=interval_of_rms(residuals_g, sd_g),
        )  # fmt: skip

    def _at_largest(self) -> dict[str, Any]:
        pairs = list(zip(self.found.legs, self.found.residuals_ug, strict=True))
        leg, residuals_ug = max(pairs, key=lambda pair: float(np.max(np.abs(pair[1]), initial=0.0)))
        at_c = leg.temperature_c[int(np.argmax(np.abs(residuals_ug)))]
        return {"cycle": leg.cycle, "leg": leg.name, "at_c": float(at_c)}

    def _differences(self) -> Iterator[Finding]:
        """The loop and the change between cycles, where there are any."""
        flags = ("lag",) if self.found.is_lag else ()
        hysteresis = "largest difference between rising and falling temperature"
        repeatability = "largest difference between a cycle and the first"
        for quantity, name, differences, flagged in (
            ("K0/hysteresis", hysteresis, self.found.loops, flags),
            ("K0/repeatability", repeatability, self.found.changes, ()),
        ):
            if differences:
                yield self._largest(quantity, name, differences, flagged)

    def _largest(self, quantity: str, name: str, differences: Sequence[Differences], flags: tuple[str, ...]) -> Finding:
        values_g = np.concatenate([each.ug for each in differences]) / UG_PER_G
        sd_g = _known_sd(scatter_sd([each.ug / UG_PER_G for each in differences], COUNT_STRIDE), self._sd_g())
        by_scatter, by_selection = largest_u(values_g, sd_g)
        widest = max(differences, key=lambda each: float(np.max(np.abs(each.ug))))
        at: dict[str, Any] = {"cycle": widest.cycle} | ({"leg": widest.leg} if widest.leg else {})
        at["at_c"] = float(widest.temperature_c[int(np.argmax(np.abs(widest.ug)))])
        value_g = float(np.max(np.abs(values_g)))
        lines = [
            BudgetLine(SCATTER, "A", by_scatter), BudgetLine(SELECTION, "A", by_selection),
            self._scale_error(value_g),
        ]  # fmt: skip
        if quantity == "K0/hysteresis":
            lines += [self._scale_left(np.sqrt(2)), BudgetLine(LAG, "alias", 0.0)]
        interval = interval_of_largest(values_g, sd_g)
        return self._finding(quantity, name, value_g, "g", lines, at, flags, interval=interval)

    # Jumps and lag

    def _jumps(self) -> Iterator[Finding]:
        """How many, the largest, and each of them."""
        jumps = self.found.jumps
        threshold = f"steps of more than {self.limits.jump_threshold_ug:g} µg between {self.limits.jump_window} samples"
        yield self._finding("K0/jumps", threshold, float(len(jumps)), "1", [], {})
        largest = max(jumps, key=lambda jump: abs(jump.size_ug), default=None)
        size_g = abs(largest.size_ug) / UG_PER_G if largest else 0.0
        u_g = largest.u_ug / UG_PER_G if largest else self._sd_g()
        lines = [BudgetLine(SCATTER, "A", u_g), self._scale_error(size_g)]
        at = _at_jump(largest) if largest else {}
        yield self._finding("K0/largest_jump", "the largest of them, 0 when there is none", size_g, "g", lines, at)
        for number, jump in enumerate(jumps, start=1):
            lines = [BudgetLine(SCATTER, "A", jump.u_ug / UG_PER_G), self._scale_error(jump.size_ug / UG_PER_G)]
            size_g, name = jump.size_ug / UG_PER_G, "after minus before in time"
            yield self._finding("K0/jump", name, size_g, "g", lines, _at_jump(jump), id_tail=f"/{number}")

    def _lag(self) -> Iterator[Finding]:
        """The time by which the output is behind the thermometer, where that is what the loop is."""
        lag = self.found.lag
        if lag is None or not self.found.is_lag:
            return
        lag_s = -lag.rate_g_s_per_c / lag.slope_g_per_c
        leg_s = float(np.median([np.ptp(leg.time_s) for leg in self.found.legs]))
        lines = [
            BudgetLine("turns of the ramp, behind which the loop is not open yet", "B", lag_s**2 / leg_s),
            BudgetLine(SCATTER, "A", self._sd_g() / abs(lag.slope_g_per_c) * self._rate_gain()),
        ]
        name = "by which the output is behind the thermometer"
        yield self._finding("K0/lag", name, lag_s, "s", lines, {})

    def _rate_gain(self) -> float:
        """Standard uncertainty of the coefficient of a rate of ±r for samples that scatter by 1: 1 / (r √n)."""
        legs = self.found.legs
        rate_c_per_s = float(np.median([np.ptp(leg.temperature_c) / np.ptp(leg.time_s) for leg in legs]))
        return 1 / (rate_c_per_s * float(np.sqrt(len(self.found.line.residuals))))

    # As a tilt meter

    def _tilt(self) -> Iterator[Finding]:
        bias_g = np.concatenate([leg.output_g for leg in self.found.legs])
        residuals_g = np.concatenate(self.found.residuals_ug) / UG_PER_G
        origin = TiltOrigin(
            self._subject, tuple(leg.step for leg in self.level), self._sd_g(), None, scale_u=self.misalignment_u_rad,
            scale_shared=self._subject.id("K1"), contained=LAG,
        )  # fmt: skip
        return tilt_findings(bias_g, bias_g - residuals_g, origin)

    # The scale factor

    def _scale_slope(self) -> Finding:
        line = self.scale.line
        relative = 1 / float(line.coefficients[0])
        slope = float(line.coefficients[1]) / line.scale * relative
        lines = [
            *self._scatter_of_scale_slope(),
            self._thermometer(slope),
            BudgetLine("bias: its change between the 0 g part and the 1 g part", "B", self._bias_slope_change()),
        ]
        at, name = {"temperature_c": line.centre}, "relative slope of the straight line over temperature"
        steps = tuple(leg.step for leg in (*self.level, *self.upright))
        return self._finding("K1/temperature_coefficient", name, slope, "1/°C", lines, at, steps=steps)

    def _model(
        self, quantity: str, unit: str, fit: PolynomialFit, legs: int, left_out: tuple[str, ...]
    ) -> TemperatureModel:
        return TemperatureModel.of_fit(
            fit,
            id=self._subject.id(f"{quantity}/model={fit.degree}"),
            uut=self.unit.serial,
            quantity=quantity,
            unit=unit,
            used=legs,
            left_out=left_out,
        )

    # Sources of uncertainty

    def _sd_g(self) -> float:
        """Standard deviation of a sample about anything smooth."""
        smooth = [residuals_ug / UG_PER_G for residuals_ug in self.found.residuals_ug]
        return _known_sd(scatter_sd(smooth, COUNT_STRIDE), self.found.line.residual_sd)

    def _bias_slope_change(self) -> float:
        """What changes of the bias do to the slope of K1, in 1/°C: what cycles tell of it, beside scatter; 0 with one.

        Only what a change has of a slope makes one of K1. If that of every cycle is as another's, with the standard
        deviation s, the mean of n cycles at 1 g less that of n at 0 g has s √(2/n), and two cycles differ by s √2.
        """
        sd_g = _known_sd(scatter_sd([each.ug / UG_PER_G for each in self.changes], COUNT_STRIDE), self._sd_g())
        squares = []
        for each in self.changes:
            away_c = each.temperature_c - np.mean(each.temperature_c)
            if spread := float(np.sum(away_c**2)):
                squares.append((float(away_c @ each.ug) / UG_PER_G / spread) ** 2 - sd_g**2 / spread)
        cycles = len({leg.cycle for leg in self.level})
        return float(np.sqrt(max(np.mean(squares) if squares else 0.0, 0.0) / cycles))

    def _scatter_of_slope(self) -> list[BudgetLine]:
        """Of the bias, in g/°C."""
        found = self._level_scatter
        if found is None:
            return [BudgetLine(SCATTER, "A", self._sd_g() * _slope_gain(self.level), self.found.line.dof or None)]
        return _scatter_lines(found, self._per_g)

    def _scatter_of_scale_slope(self) -> list[BudgetLine]:
        """Of the scale factor, relative to it, in 1/°C."""
        at_0g, at_1g = slope_scatter(self.whole), slope_scatter(self.upright)
        if at_0g is not None and at_1g is not None:
            return _scatter_lines(at_1g.together(at_0g), self._per_g)
        line = self.scale.line
        sd = _known_sd(scatter_sd([_finite(leg.output) for leg in self.upright], COUNT_STRIDE), line.residual_sd)
        gains = sd * self._per_g * _slope_gain(self.upright), self._sd_g() * _slope_gain(self.whole)
        return [BudgetLine(SCATTER, "A", float(np.hypot(*gains)), line.dof or None)]

    @cached_property
    def _level_scatter(self) -> SlopeScatter | None:
        """Of the slope of the 0 g part, which is in that of the scale factor too."""
        return slope_scatter(self.level)

    @property
    def _per_g(self) -> float:
        """The g that are one unit of the output."""
        return 1 / abs(float(self.scale.line.coefficients[0]))

    def _thermometer(self, slope: float) -> BudgetLine:
        _, gain = self.data.bench.thermometer_u(self.unit.temperature)
        return BudgetLine(f"{self.unit.temperature}: gain", "B", abs(slope) * gain, None, self.unit.temperature)

    def _scale_error(self, value_g: float) -> BudgetLine:
        """The misalignment in K1, relative to it as large as in rad."""
        return BudgetLine(
            "K1: misalignment in it", "B", abs(value_g) * self.misalignment_u_rad, None, self._subject.id("K1")
        )

    def _scale_left(self, factor: float = 1.0) -> BudgetLine:
        """What K1 is not known by over temperature, on all that a head off the level puts out at 0 g beside the bias.

        What the polynomials of K1 leave of the 1 g part, beside scatter, is an error of K1 that changes with the
        temperature; 1° off the level it acts on 17 mg. Between two cycles it cancels.
        """
        k1 = abs(float(self.scale.line.coefficients[0]))
        scatter = _known_sd(scatter_sd([_finite(leg.output) for leg in self.upright], COUNT_STRIDE), 0.0) / k1
        left = float(np.sqrt(max(self.scale.left**2 - scatter**2, 0.0)))
        read_g = float(np.mean([np.nanmean(leg.output) for leg in self.level])) / k1
        return BudgetLine("K1: what its polynomial leaves", "B", float(factor * abs(read_g) * left))

    # Forms

    @property
    def _subject(self) -> Subject:
        return self.data.subject(self.unit)

    def _finding(
        self,
        quantity: str,
        name: str,
        value: float,
        unit: str,
        lines: Sequence[BudgetLine],
        at: Mapping[str, Any],
        flags: tuple[str, ...] = (),
        id_tail: str = "",
        steps: tuple[str, ...] = (),
        interval: Interval | None = None,
    ) -> Finding:
        steps = steps or tuple(leg.step for leg in self.level)
        if interval is not None:
            interval = interval.beside(abs(value), math.hypot(*(line.u for line in lines if line.type == "B")))
        return self._subject.finding(quantity, name, value, unit, lines, at, steps, id_tail, flags, interval)


def _scatter_lines(found: SlopeScatter, scale: float) -> list[BudgetLine]:
    counting = [BudgetLine(COUNTING, "B", found.counted * scale)] if found.counted else []
    return [*counting, BudgetLine(SCATTER, "A", found.own * scale, found.dof)]


def _at_jump(jump: RampJump) -> dict[str, Any]:
    return {"cycle": jump.cycle, "leg": jump.leg, "at_c": jump.temperature_c}


def _known_sd(sd: float, otherwise: float) -> float:
    """A standard deviation, or another one where there were too few values to tell it."""
    return float(sd if np.isfinite(sd) else otherwise if np.isfinite(otherwise) else 0.0)


def _slope_gain(legs: Sequence[RampLeg]) -> float:
    """Standard uncertainty of the slope of a straight line through samples that scatter by 1, in 1/°C."""
    temperature_c = np.concatenate([_finite(leg.temperature_c) for leg in legs])
    return 1 / (float(np.std(temperature_c)) * float(np.sqrt(len(temperature_c))))


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]
