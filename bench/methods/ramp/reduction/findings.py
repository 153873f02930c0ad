"""Findings of a temperature ramp, each with its budget (`ramp_budget`)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.ramp.reduction.budget import COUNTING, LAG, SCATTER, RampBudget
from bench.methods.ramp.reduction.characteristic import UG_PER_G, Differences, DynamicCharacteristic, RampJump
from bench.methods.ramp.reduction.reduced import ReducedRamp
from bench.metrology.calibration.dynamic import SECONDS, DynamicBias
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.extremes import interval_of_rms
from bench.metrology.largest import largest_of
from bench.metrology.least_squares import PolynomialFit
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.coverage import COVERAGE, coverage_factor
from bench.metrology.results.curves import Constant, Equation, TemperatureModel
from bench.metrology.results.finding import Finding, Interval
from bench.metrology.tilt_findings import TiltOrigin, tilt_findings


@dataclass(frozen=True)
class RampFindings:
    """Results of one unit: its legs at 0 g and at 1 g, its scale factor, and the characteristic of the legs at 0 g."""

    budget: RampBudget

    def findings(self) -> Iterator[Finding]:
        """All findings that a limit may name, and each jump."""
        yield self._slope()
        yield from self._residuals()
        yield from self._differences()
        yield from self._jumps()
        yield from self._lag()
        yield self._scale_slope()
        yield from self._tilt()

    def models(self, left_out: tuple[str, ...]) -> Iterator[TemperatureModel | Equation]:
        """Straight line of the bias, misalignment included, the scale factor, and the dynamic model of the bias."""
        yield from self._curves(left_out)
        dynamic = self._dynamic()
        if dynamic is not None:
            b0, b1 = dynamic.bias.coefficients
            constants = {"B0": Constant(b0, "g"), "B1": Constant(b1, "g/°C"), "Bd": dynamic.rate}
            fastest = dynamic.fastest_c_per_min
            yield Equation(
                self.budget.subject.id("K0/model=dynamic"), self.budget.unit.serial, "K0/dynamic",
                "K0 = B0 + B1 T + Bd dT/dt", constants,
                {"temperature_c": dynamic.bias.valid_c, "rate_c_per_min": (-fastest, fastest)},
            )  # fmt: skip

    def _curves(self, left_out: tuple[str, ...]) -> Iterator[TemperatureModel]:
        yield self._model("K0", "g", self._found.line, len(self._ramp.level), left_out)
        ramp, output_unit = self._ramp, self.budget.unit.output_unit
        yield self._model("K1", f"{output_unit}/g", ramp.scale.model, len(ramp.upright), left_out)

    def compensation(self) -> Compensation:
        """Conversion of an output to an acceleration; the bias contains the misalignment at 0 g."""
        bias, scale = self._curves(())
        unit = self.budget.unit
        return Compensation(unit.measured_by, unit.output_unit, "g", scale=scale, bias=bias, dynamic=self._dynamic())

    def _dynamic(self) -> DynamicBias | None:
        """Model of the bias over temperature and dT/dt; None if the rate did not change."""
        found, lag = self._found, self._found.lag
        if lag is None:
            return None
        line = TemperatureModel(
            "", self.budget.unit.serial, "K0", "g", 0.0, 1.0, (lag.bias_g, lag.slope_g_per_c), valid_c=found.line.valid
        )
        rate = Constant(lag.rate_g_s_per_c / SECONDS, "g·min/°C")
        return DynamicBias(line, rate, lag.fastest_c_per_s * SECONDS)

    # Straight line and departures from it

    def _slope(self) -> Finding:
        slope, budget = self._ramp.bias_slope, self.budget
        lines = [
            *budget.scatter_of_slope(), budget.thermometer(slope), *budget.drifts(lambda ramp: ramp.bias_slope),
            budget.scale_error(slope),
        ]  # fmt: skip
        name, at = "slope of the straight line over temperature", {"temperature_c": self._found.line.centre}
        return self._finding("K0/temperature_coefficient", name, slope, "g/°C", lines, at)

    def _residuals(self) -> Iterator[Finding]:
        found, budget, sd_g = self._found, self.budget, self.budget.sd_g
        residuals_g = [residuals_ug / UG_PER_G for residuals_ug in found.residuals_ug]
        largest = largest_of(residuals_g, [np.full(len(each), sd_g) for each in residuals_g])
        lines = [
            *largest.lines, *budget.drifts(lambda ramp: ramp.found.line.max_residual),
            budget.scale_error(largest.value), budget.scale_left(), BudgetLine(LAG, "alias", 0.0),
        ]  # fmt: skip
        name = "largest residual of the straight line"
        yield self._finding(
            "K0/model_residual", name, largest.value, "g", lines, self._at_largest(), interval=largest.interval
        )
        rms_g = found.rms_residual_ug / UG_PER_G
        added_g = rms_g - float(np.sqrt(max(rms_g**2 - sd_g**2, 0.0)))
        along = budget.scatter_of_rms()
        lines = [
            *along,
            BudgetLine("samples: scatter is part of it", "A", added_g),
            *budget.drifts(lambda ramp: ramp.found.rms_residual_ug / UG_PER_G),
            budget.scale_error(rms_g), budget.scale_left(), BudgetLine(LAG, "alias", 0.0),
        ]  # fmt: skip
        yield self._finding(
            "K0/model_residual_rms", "root mean square of the residuals", rms_g, "g", lines, {},
            interval=interval_of_rms(found.line.residuals, sd_g, math.hypot(*(_normal_u(line) for line in along))),
        )  # fmt: skip

    def _at_largest(self) -> dict[str, Any]:
        pairs = list(zip(self._found.legs, self._found.residuals_ug, strict=True))
        leg, residuals_ug = max(pairs, key=lambda pair: float(np.max(np.abs(pair[1]), initial=0.0)))
        at_c = leg.temperature_c[int(np.argmax(np.abs(residuals_ug)))]
        return {"cycle": leg.cycle, "leg": leg.name, "at_c": float(at_c)}

    def _differences(self) -> Iterator[Finding]:
        """Loop and change between cycles, if there are any."""
        found, budget = self._found, self.budget
        if found.loops:
            name = "largest difference between rising and falling temperature"
            lines = [budget.scale_left(np.sqrt(2)), BudgetLine(LAG, "alias", 0.0)]
            flags = ("lag",) if found.is_lag else ()
            by_drift = budget.drifts(lambda ramp: (ramp.found.hysteresis_ug or 0.0) / UG_PER_G)
            yield self._largest("K0/hysteresis", name, found.loops, [*by_drift, *lines], flags)
        if found.changes:
            name = "largest difference between a cycle and the first"
            by_drift = budget.drifts(lambda ramp: (ramp.found.repeatability_ug or 0.0) / UG_PER_G)
            yield self._largest("K0/repeatability", name, found.changes, by_drift)

    def _largest(
        self,
        quantity: str,
        name: str,
        differences: Sequence[Differences],
        more: Sequence[BudgetLine],
        flags: tuple[str, ...] = (),
    ) -> Finding:
        largest = largest_of([each.ug / UG_PER_G for each in differences], self.budget.sds_of(differences))
        widest = max(differences, key=lambda each: float(np.max(np.abs(each.ug))))
        at: dict[str, Any] = {"cycle": widest.cycle} | ({"leg": widest.leg} if widest.leg else {})
        at["at_c"] = float(widest.temperature_c[int(np.argmax(np.abs(widest.ug)))])
        lines = [*largest.lines, self.budget.scale_error(largest.value), *more]
        return self._finding(quantity, name, largest.value, "g", lines, at, flags, interval=largest.interval)

    # Jumps and lag

    def _jumps(self) -> Iterator[Finding]:
        """Number of jumps, the largest, and each of them."""
        jumps, limits = self._found.jumps, self._ramp.limits
        threshold = f"steps of more than {limits.jump_threshold_ug:g} µg between {limits.jump_window} samples"
        yield self._finding("K0/jumps", threshold, float(len(jumps)), "1", [], {})
        largest = max(jumps, key=lambda jump: abs(jump.size_ug), default=None)
        size_g = abs(largest.size_ug) / UG_PER_G if largest else 0.0
        u_g = largest.u_ug / UG_PER_G if largest else self.budget.sd_g
        lines = [BudgetLine(SCATTER, "A", u_g), self.budget.scale_error(size_g)]
        at = _at_jump(largest) if largest else {}
        yield self._finding("K0/largest_jump", "the largest of them, 0 when there is none", size_g, "g", lines, at)
        for number, jump in enumerate(jumps, start=1):
            lines = [BudgetLine(SCATTER, "A", jump.u_ug / UG_PER_G), self.budget.scale_error(jump.size_ug / UG_PER_G)]
            size_g, name = jump.size_ug / UG_PER_G, "after minus before in time"
            yield self._finding("K0/jump", name, size_g, "g", lines, _at_jump(jump), id_tail=f"/{number}")

    def _lag(self) -> Iterator[Finding]:
        """Lag of the output behind the thermometer, if the loop is lag."""
        lag = self._found.lag
        if lag is None or not self._found.is_lag:
            return
        lag_s = -lag.rate_g_s_per_c / lag.slope_g_per_c
        leg_s = float(np.median([np.ptp(leg.time_s) for leg in self._found.legs]))
        lines = [
            BudgetLine("turns of the ramp, behind which the loop is not open yet", "B", lag_s**2 / leg_s),
            BudgetLine(SCATTER, "A", self.budget.sd_g / abs(lag.slope_g_per_c) * self._rate_gain()),
        ]
        name = "by which the output is behind the thermometer"
        yield self._finding("K0/lag", name, lag_s, "s", lines, {})

    def _rate_gain(self) -> float:
        """Standard uncertainty of the coefficient of a rate ±r, for samples with standard deviation 1: 1 / (r √n)."""
        legs = self._found.legs
        rate_c_per_s = float(np.median([np.ptp(leg.temperature_c) / np.ptp(leg.time_s) for leg in legs]))
        return 1 / (rate_c_per_s * float(np.sqrt(len(self._found.line.residuals))))

    # As a tilt meter

    def _tilt(self) -> Iterator[Finding]:
        bias_g = np.concatenate([leg.output_g for leg in self._found.legs])
        residuals_g = np.concatenate(self._found.residuals_ug) / UG_PER_G
        budget = self.budget
        origin = TiltOrigin(
            budget.subject, tuple(leg.step for leg in self._ramp.level), budget.sd_g, None,
            scale_u=budget.misalignment_u_rad, scale_shared=budget.subject.id("K1"), contained=LAG,
        )  # fmt: skip
        return tilt_findings(bias_g, bias_g - residuals_g, origin)

    # The scale factor

    def _scale_slope(self) -> Finding:
        ramp, slope, budget = self._ramp, self._ramp.scale_slope, self.budget
        lines = [
            *budget.scatter_of_scale_slope(), budget.thermometer(slope), *budget.drifts(lambda ramp: ramp.scale_slope),
            budget.bias_slope_change(),
        ]  # fmt: skip
        at, name = {"temperature_c": ramp.scale.line.centre}, "relative slope of the straight line over temperature"
        steps = tuple(leg.step for leg in (*ramp.level, *ramp.upright))
        return self._finding("K1/temperature_coefficient", name, slope, "1/°C", lines, at, steps=steps)

    def _model(
        self, quantity: str, unit: str, fit: PolynomialFit, legs: int, left_out: tuple[str, ...]
    ) -> TemperatureModel:
        return TemperatureModel.of_fit(
            fit,
            id=self.budget.subject.id(f"{quantity}/model={fit.degree}"),
            uut=self.budget.unit.serial,
            quantity=quantity,
            unit=unit,
            used=legs,
            left_out=left_out,
        )

    # Parts of findings

    @property
    def _ramp(self) -> ReducedRamp:
        return self.budget.ramp

    @property
    def _found(self) -> DynamicCharacteristic:
        return self.budget.ramp.found

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
        steps = steps or tuple(leg.step for leg in self._ramp.level)
        if interval is not None:
            known = (line.u for line in lines if line.type == "B" and line.kind != COUNTING)
            interval = interval.beside(math.hypot(*known))
        return self.budget.subject.finding(quantity, name, value, unit, lines, at, steps, id_tail, flags, interval)


def _normal_u(line: BudgetLine) -> float:
    """Standard uncertainty of which twice covers as much as U, whatever the degrees of freedom."""
    return line.u * coverage_factor(line.dof) / COVERAGE


def _at_jump(jump: RampJump) -> dict[str, Any]:
    return {"cycle": jump.cycle, "leg": jump.leg, "at_c": jump.temperature_c}
