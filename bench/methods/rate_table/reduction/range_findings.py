"""Findings of the errors of a sensor over its range: the points, the curve through them, and their limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.rate_table.reduction.range_points import RangeBlocks, Turning
from bench.methods.rate_table.reduction.samples import mean_c
from bench.methods.rate_table.reduction.stated_scale import of_stated_scale, shared_per_degree, stated_scale
from bench.metrology.bench_uncertainty import WOBBLE
from bench.metrology.calibration.linearity import Linearity, LinearityPoint, fit_linearity
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.curves import Constant, Equation
from bench.metrology.results.finding import Finding, Subject, UnitResult, Verdict
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

BIAS = "readings at rest"
TILT = "axis: level, in readings at rest at one angle"
WARMER = "scale factor: temperature against that at the low rates"
BY_RADIUS = "low rates: by way of the radius"
OTHERWISE_WARM = "scale factor: temperature against that of the curve"
COMMON = frozenset({BIAS, TILT, WOBBLE, BY_RADIUS, WARMER, OTHERWISE_WARM})  # one error at all points
TERMS = {
    "scale_error": "scale error", "asymmetry": "asymmetry · sign v", "quadratic": "quadratic · v/F",
    "cubic": "cubic · (v/F)²",
}  # fmt: skip
OF_THE_CURVE = {
    "scale_error": ("scale_error", "of the curve through the points, against the stated scale factor"),
    "asymmetry": ("asymmetry", "of the curve: half of what the scale factors of both senses differ by"),
    "quadratic": ("nonlinearity/quadratic", "of the curve, at the full scale"),
    "cubic": ("nonlinearity/cubic", "of the curve, at the full scale"),
}


@dataclass(frozen=True, slots=True)
class PointError:
    """Error of a sensor at one rate, against the `true` value, with its conditions and the lines of its budget."""

    turning: Turning
    at: Mapping[str, Any]
    true: float
    error: float
    lines: Sequence[BudgetLine]

    @property
    def saturated(self) -> bool:
        """True if the sensor was at the end of its range."""
        return self.turning.steady.saturated

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, k = 2."""
        return 2 * float(np.linalg.norm([line.u for line in self.lines]))


@dataclass(frozen=True, slots=True)
class RangeCurve:
    """Errors over the range, and the curve through them if it is determined.

    `quantity` is the true quantity, `full_scale` the reference of the errors, None for each reading itself.
    """

    quantity: str
    points: tuple[PointError, ...]
    full_scale: float | None
    linearity: Linearity | None = None


@dataclass(frozen=True, slots=True)
class RangeFindings:
    """Range findings common to both methods: basis of the errors, sources of uncertainty, forms of results."""

    data: RunData
    unit: UnitUnderTest
    settings: Mapping[str, Any]
    quantity: str
    symbol: str
    full_scale: float

    @property
    def over(self) -> float | None:
        """Reference of the errors: the full scale, or None for each reading."""
        return self.full_scale if self.settings["linearity_basis"] == "full_scale" else None

    @property
    def subject(self) -> Subject:
        """Unit and label of the findings."""
        return self.data.subject(self.unit)

    def stable(self, turning: Turning) -> bool:
        """True if the table turned as commanded."""
        return turning.on_rate(self.settings["rate_tolerance"])

    def noise(self, turning: Turning) -> BudgetLine:
        """Line for the noise of one reading."""
        return BudgetLine(noise_of(self.unit), "A", turning.steady.u_output, turning.steady.dof)

    def of_the_voltmeter(self, value: float) -> Iterator[BudgetLine]:
        """Line for the gain of the voltmeter; its offset is in the readings at rest alike."""
        if self.unit.voltmeter is not None:
            gain, _ = self.data.bench.voltmeter(self.unit.voltmeter)
            yield gain.times(abs(value), "voltmeter: gain")

    def of_the_clock(self, value: float) -> Iterator[BudgetLine]:
        """Line for the clock of the table's rate, unless the rate of pulses depends on it too."""
        if not self.unit.is_counted:
            yield self.time_base(value)

    def time_base(self, value: float) -> BudgetLine:
        """Line for the clock of the table measurement in a value proportional to it."""
        return self.data.bench.clock(sent=self.unit.telemetry is not None).time_base.times(abs(value))

    def of_rest(self, blocks: RangeBlocks, gain: float) -> Iterator[BudgetLine]:
        """Lines for the bias, common to all readings; at one angle with a tilt of the axis, which turns cancel."""
        yield BudgetLine(BIAS, "A", gain * blocks.bias.u_output, _dof(blocks), self.subject.id("rest"))
        if self.symbol == "g" and blocks.rest is not None and blocks.rest.of_one_angle:
            yield from (line.times(gain) for line in self._tilted(at_one_angle=True))

    def warmer(self, u: float) -> BudgetLine:
        """Line for the change of the scale factor with 1 °C, common to all points that are warmer."""
        return BudgetLine(WARMER, "B", u, None, self._shared_per_degree)

    def as_stated(self, value: float, at_c: float) -> list[BudgetLine]:
        """Lines of the stated scale factor in a value proportional to it, for a unit at a temperature."""
        return [line.times(value) for line in of_stated_scale(at_c, self.settings, self.data, self.unit)]

    def at_rest(self, blocks: RangeBlocks, quantity: str, name: str) -> Finding:
        """Finding of the bias."""
        lines = [BudgetLine(BIAS, "A", blocks.bias.u_output, _dof(blocks))]
        if self.symbol == "g" and blocks.rest is not None:
            lines += self._tilted(at_one_angle=blocks.rest.of_one_angle)
        if self.unit.voltmeter is not None:
            _, offset = self.data.bench.voltmeter(self.unit.voltmeter)
            lines.append(offset.times(1 / self._scale.value, "voltmeter: offset"))
            lines += self.of_the_voltmeter(blocks.bias.output)
        return self.subject.finding(
            quantity, name, blocks.bias.output, self.symbol, lines, {}, tuple(blocks.rest_steps)
        )

    def _tilted(self, *, at_one_angle: bool) -> Iterator[BudgetLine]:
        """Lines for gravity in readings at rest.

        For an axis that tilts with a turn, half of it contributes at any direction of the sensor, because the product
        of two sines has a mean.
        """
        bench = self.data.bench
        share = 1.0 if at_one_angle else 0.5
        if at_one_angle:
            yield bench.level.times(1.0, TILT)
        yield bench.wobble.times(share)

    def _errors(self, point: PointError) -> Iterator[Finding]:
        """Findings of the error of a point, absolute and relative to the reading or the full scale."""
        at, error, unstable = point.at, point.error, not self.stable(point.turning)
        flags = tuple(flag for flag, holds in (("clipped", point.saturated), ("off_rate", unstable)) if holds)
        step, tail = (point.turning.step,), f"@{at['point']}"
        name = "measured less the bias and what is true"
        found = self.subject.finding(self.quantity, name, error, self.symbol, point.lines, at, step, tail)
        over = self.full_scale if self.over is not None else abs(point.true)
        relative = [line.times(1 / over) for line in point.lines]
        part = "of the full scale" if self.over is not None else "of what is true"
        judged = self.subject.finding(f"{self.quantity}/relative", part, error / over, "1", relative, at, step, tail)
        verdict: Verdict | None = "INVALID" if unstable else None
        yield replace(found, flags=flags, verdict=verdict)
        yield replace(judged, flags=flags, verdict=verdict)

    def _saturated(self, blocks: RangeBlocks) -> Finding:
        """Finding of the number of points at which the sensor was saturated."""
        count = sum(turning.steady.saturated for turning in blocks.turning)
        name = "points at which more than 1 % of the samples are at the clip level"
        return self.subject.finding("saturated_points", name, float(count), "1", [], {}, ())

    # The curve through the points

    def with_curve(
        self, blocks: RangeBlocks, findings: Sequence[Finding], quantity: str, points: Sequence[PointError],
        terms: Sequence[str],
    ) -> UnitResult:  # fmt: skip
        """Results of the unit: those of its points, and the curve through them, at their mean temperature."""
        blocks.flags += self._warming_up(points, blocks.warmed_c)
        errors = [finding for point in points for finding in self._errors(point)]
        findings = [*findings, *errors, self._saturated(blocks)]
        read = [point for point in points if self.stable(point.turning) and not point.saturated]
        found_at_c = mean_c([point.turning.temperature_c for point in read])
        of_curve_points = [
            LinearityPoint(
                point.true + point.error, point.true, [*point.lines, *self._to_one_temperature(point, found_at_c)]
            )
            for point in read
        ]
        found = fit_linearity(of_curve_points, terms, self.full_scale, COMMON, self._in_proportion)
        if found is None:
            return self.result(blocks, findings, RangeCurve(quantity, tuple(points), self.over))
        linearity, lines = found
        at, steps = {} if found_at_c is None else {"at_c": found_at_c}, tuple(point.turning.step for point in read)
        of_curve = [
            self.subject.finding(*OF_THE_CURVE[name], value, "1", lines[name], at, steps)
            for name, value in linearity.coefficients.items()
        ]
        scale, bias = self._scale, findings[0]
        result = self.result(blocks, [*findings, *of_curve], RangeCurve(quantity, tuple(points), self.over, linearity))
        offset = Constant(bias.value * scale.value, self.unit.output_unit, bias.u * abs(scale.value))
        compensation = Compensation(
            self.unit.measured_by, self.unit.output_unit, self.symbol, scale=scale, offset=offset, linearity=linearity,
            found_at_c=found_at_c,
        )  # fmt: skip
        model = self._model(quantity, linearity, bias, of_curve)
        return replace(result, models=(model,), compensations=(compensation,))

    def _warming_up(self, points: Sequence[PointError], change_c: float) -> Iterator[Flag]:
        """The flag of a gyro whose scale factor changed with its temperature by more than an error is uncertain.

        An accelerometer is compared with itself.
        """
        per_c = float(self.settings["scale_per_c_u"])
        if self.symbol != "g" and any(abs(point.true) * per_c * change_c > point.expanded / 2 for point in points):
            yield Flag("warming_up", values={"change": f"{change_c:.2g}", "ppm": f"{per_c * change_c * 1e6:.2g}"})

    def _to_one_temperature(self, point: PointError, at_c: float | None) -> Iterator[BudgetLine]:
        """Uncertainty of a point from the temperature coefficient of the scale factor, in a curve at one temperature.

        The temperature of the unit differs between points, and its thermometer is uncertain. An accelerometer is
        compared with itself at low rates, which contains these contributions already, or does without the thermometer.
        """
        if self.symbol == "g" or at_c is None:
            return
        per_c = point.true * float(self.settings["scale_per_c_u"])
        warmer_c = point.turning.temperature_c - at_c
        yield BudgetLine(OTHERWISE_WARM, "B", per_c * warmer_c, None, self._shared_per_degree)
        yield self._thermometer(at_c).times(abs(per_c))

    def _thermometer(self, at_c: float) -> BudgetLine:
        return self.data.bench.temperature(self.unit.temperature, at_c)

    @property
    def _shared_per_degree(self) -> str:
        return shared_per_degree(self.data, self.unit)

    def _model(self, quantity: str, linearity: Linearity, bias: Finding, of_curve: Sequence[Finding]) -> Equation:
        constants = {"S": self._scale, "bias": Constant(bias.value, bias.unit, bias.u)}
        constants |= {
            name.replace("_", " "): Constant(each.value, "1", each.u)
            for name, each in zip(linearity.coefficients, of_curve, strict=True)
        }
        constants["F"] = Constant(self.full_scale, self.symbol, 0.0)
        key = {"rate": "rate_dps", "acceleration": "acceleration_g"}[quantity]
        terms = " + ".join(TERMS[name] for name in linearity.coefficients)
        form = f"output / S - bias = v · (1 + {terms})"
        return Equation(
            self.subject.id("range/model"), self.unit.serial, "range", form, constants, {key: linearity.valid}
        )

    @property
    def _in_proportion(self) -> frozenset[str]:
        """Sources of one relative error of all rates: voltmeter gain, a clock not shared by the output, thermometer."""
        certified = (*self.of_the_voltmeter(1.0), *self.of_the_clock(1.0), self._thermometer(0.0))
        return frozenset(line.source for line in certified)

    @property
    def _scale(self) -> Constant:
        """Stated scale factor, the reference of the errors."""
        return stated_scale(self.unit, self.settings, self.symbol)

    def result(self, blocks: RangeBlocks, findings: Sequence[Finding], curve: RangeCurve | None) -> UnitResult:
        """Results of the unit."""
        flags = list(blocks.flags)
        for each in blocks.turning:
            if not self.stable(each):
                flags.append(Flag("off_rate", at=each.step))
            if each.steady.saturated:
                flags.append(Flag("clipped", at=each.step))
        if blocks.rest is not None and blocks.rest.of_one_angle:
            flags.append(Flag("rest_of_one_angle"))
        return UnitResult(
            place=self.unit.place, uut=self.unit.serial, findings=tuple(findings), models=(),
            left_out=tuple(blocks.left_out), flags=tuple(dict.fromkeys(flags)), detail=curve,
        )  # fmt: skip


def noise_of(unit: UnitUnderTest, what: str = "sensor") -> str:
    """Name in budgets of the scatter of an output, of the sensor or of readings with it."""
    if unit.is_counted:
        return f"{what}: noise and steps of counting"
    return f"{what}: noise and steps of codes" if unit.telemetry is not None else f"{what} and voltmeter: noise"


def _dof(blocks: RangeBlocks) -> int | None:
    """Degrees of freedom of the readings at rest, which are few compared with the fitted terms."""
    return blocks.rest.dof if blocks.rest is not None else None
