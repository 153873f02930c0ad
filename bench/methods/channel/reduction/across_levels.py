"""Results from all levels of a channel together: comparison of slopes, coefficients of the channel, and its models.

A gain error of a thermometer is common to all levels: it changes slopes, but cancels in comparisons of levels. A drift
changes the slopes of two levels in opposite directions if one was heated and the other cooled. It is unknown whether
drifts continue alike from one ramp to the next, so the worst case is assumed: independent in comparisons of levels,
fully correlated in the coefficients of the channel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.channel.reduction.acceleration import StatedAccelerometer, to_specific_force
from bench.methods.channel.reduction.compared_levels import GRAVITY_REFERENCE, READ_OUT, Compared, Level
from bench.methods.channel.reduction.decision import ChannelDrift
from bench.methods.channel.reduction.findings import ChannelFindings
from bench.methods.channel.words import OWN_SLOPE, SERVES_TOO, SLOPE_FROM
from bench.metrology.calibration.temperature import Compensation, Curve
from bench.metrology.least_squares import Array
from bench.metrology.outputs import sampled_as
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.curves import Constant, Equation, TemperatureModel
from bench.metrology.results.finding import Finding
from bench.metrology.results.flag import Flag

MARGINAL = "decision_marginal"  # flag of a deviation


@dataclass(frozen=True)
class ChannelConclusions:
    """Findings and models of one unit that need all its levels."""

    of_levels: ChannelFindings
    compared: Sequence[Compared]
    drift: ChannelDrift | None

    @property
    def _usable(self) -> list[Level]:
        return [level for level in self.of_levels.levels if level.run.valid]

    def findings(self) -> Iterator[Finding]:
        """Deviations of the slopes, and the two coefficients of the channel."""
        for compared in self.compared:
            yield from self._deviations(compared)
        if self.drift is not None:
            yield from self._coefficients(self.drift)

    def models(self) -> Iterator[Equation]:
        """Model of the rate over temperature of each level, by its own slope or that of its reference; then slopes."""
        references = {each.level.name: each for each in self.compared}
        for level in self._usable:
            yield self._model(level, references.get(level.name))
        if self.drift is not None:
            yield self._channel_model(self.drift)

    def compensations(self) -> Iterator[Compensation]:
        """For each slope that serves levels: conversion of a rate to the reference temperature; then to g."""
        references = {each.level.name: each for each in self.compared}
        served: dict[str, list[Level]] = {}
        by_name = {level.name: level for level in self._usable}
        for level in self._usable:
            slope_from = self._slope_from(level, references.get(level.name))
            served.setdefault(slope_from.name, []).append(level)
        for name, levels in served.items():
            yield self._compensation(by_name[name], levels)
        # Without the line through all slopes the drift between two levels is unknown.
        up, drift = by_name.get(GRAVITY_REFERENCE), self.drift
        if up is not None and drift is not None and not drift.misfit:
            yield self._to_specific_force(up, by_name, drift)

    def _to_specific_force(self, up: Level, levels: Mapping[str, Level], drift: ChannelDrift) -> Compensation:
        of_levels = self.of_levels
        beta, alpha = self._coefficients(drift)
        return to_specific_force(
            of_levels.unit.measured_by, levels, of_levels.rate(up), (beta, alpha),
            self._correlation(drift, beta, alpha), StatedAccelerometer.of(of_levels.settings), of_levels.reference_c,
            sampled_as(of_levels.data, of_levels.unit),
        )  # fmt: skip

    def _compensation(self, slope_from: Level, levels: Sequence[Level]) -> Compensation:
        of_levels, valid_c = self.of_levels, _ends(slope_from.run.gates.converter_c)
        unit = of_levels.unit.output_unit
        offset: Curve | None = None
        scale: Curve = Constant(1.0, "1", 0.0)
        if of_levels.settings["compare_basis"] == "raw":
            slope = of_levels.slope(slope_from)
            offset = self._line(slope, unit, 0.0, valid_c)
        else:
            scale = self._line(of_levels.relative_slope(slope_from), "1", 1.0, valid_c)
        return Compensation(
            f"{of_levels.unit.measured_by}@{slope_from.name}", unit, unit, scale, offset,
            serves=tuple(level.name for level in levels),
        )  # fmt: skip

    def _correlation(self, drift: ChannelDrift, beta: Finding, alpha: Finding) -> float:
        """Correlation of the errors of the coefficients: through the slopes, and by the thermometer."""
        u = np.array([level.known_run.u_slope_per_c for level in self._usable])
        of_slopes = float(np.sum(drift.gain[0] * drift.gain[1] * u**2))
        by_gain = self.of_levels.thermometer_gain(beta.value).u * self.of_levels.thermometer_gain(alpha.value).u
        by_drift = self._drifted(drift.gain[0]) * self._drifted(drift.gain[1])
        both = beta.u * alpha.u
        return float(np.clip((of_slopes + by_gain + by_drift) / both, -1, 1)) if both else 0.0

    def _drifted(self, gain: Array) -> float:
        """Effect of one standard uncertainty of the thermometer drift on a coefficient."""
        drifted: list[float] = [
            part * level.run.slope_per_c * level.drifted_share
            for part, level in zip(gain.tolist(), self._usable, strict=True)
        ]
        return sum(drifted)

    def _line(self, slope: Finding, unit: str, at_reference: float, valid_c: tuple[float, float]) -> TemperatureModel:
        """A straight line over temperature through a value at the reference, with the fitted slope."""
        reference_c = self.of_levels.reference_c
        return TemperatureModel(
            id=slope.id, uut=slope.uut, quantity=slope.quantity, unit=unit, centre=reference_c, scale=1.0,
            coefficients=(at_reference, slope.value), u=(0.0, slope.u), correlation=((1.0, 0.0), (0.0, 1.0)),
            powers_of_t=(at_reference - slope.value * reference_c, slope.value), valid_c=valid_c,
        )  # fmt: skip

    @staticmethod
    def _slope_from(level: Level, compared: Compared | None) -> Level:
        """Level whose slope serves a level: itself, or its reference."""
        shares = compared is not None and compared.comparison.decision == "share"
        return compared.reference if compared is not None and shares else level

    def _deviations(self, compared: Compared) -> Iterator[Finding]:
        ours, theirs, found = compared.level, compared.reference, compared.comparison
        at = {"run": ours.name, "reference": theirs.name, "decision": found.decision}
        raw, raw_reference = ours.run.slope_per_c, theirs.run.slope_per_c
        relative, relative_reference = ours.run.relative_slope_per_c, theirs.run.relative_slope_per_c
        for quantity, deviation, value, reference, per in (
            ("deviation/raw", found.raw, raw, raw_reference, (1.0, 1.0)),
            ("deviation/normalised", found.normalised, relative, relative_reference,
             (ours.run.rate, theirs.run.rate)),
        ):  # fmt: skip
            if not np.isfinite(deviation.value):
                continue
            lines = [
                *_named(ours, theirs, 1 / abs(per[0] * reference)),
                *_named(theirs, ours, abs(value / (per[1] * reference**2))),
                self.of_levels.drift_line(value / reference * (ours.drifted_share - theirs.drifted_share)),
            ]
            decision, is_marginal = compared.decided("raw" if quantity == "deviation/raw" else "normalised")
            name, flags = "of the slope from that of the reference", (MARGINAL,) if is_marginal else ()
            steps = (*ours.data.steps, *theirs.data.steps)
            own = {**at, "own_decision": decision}
            yield self.of_levels.finding(quantity, name, own, deviation.value, "1", lines, steps, flags)

    def _coefficients(self, drift: ChannelDrift) -> Iterator[Finding]:
        steps = tuple(step for level in self._usable for step in level.data.steps)
        for gain, (quantity, name, value, unit) in zip(drift.gain, (
            ("tempco_offset", "part of the slope that is the same at all levels", drift.offset_per_c,
             f"{self.of_levels.unit.output_unit}/°C"),
            ("tempco_scale", f"part of the slope in proportion to the {self.of_levels.output}", drift.scale_per_c,
             "1/°C"),
        ), strict=True):  # fmt: skip
            lines = [
                *self._through(gain), self.of_levels.thermometer_gain(value),
                self.of_levels.drift_line(self._drifted(gain)),
            ]  # fmt: skip
            yield self.of_levels.finding(quantity, name, {}, value, unit, lines, steps)

    def _through(self, gain: Array) -> Iterator[BudgetLine]:
        """Uncertainties of slopes in a sum with these sensitivities; lines of one kind of drift are correlated."""
        together: dict[str, float] = {}
        for factor, level in zip(gain.tolist(), self._usable, strict=True):
            for line in level.slope_lines:
                if line.kind == READ_OUT:
                    yield line.times(factor, f"{level.name}: {line.source}")
                else:
                    together[line.source] = together.get(line.source, 0.0) + factor * line.u
        for source, u in together.items():
            yield BudgetLine(source, "B", abs(u))

    def _model(self, level: Level, compared: Compared | None) -> Equation:
        """Line of a level; if it shares the model of its reference, with the slope of that."""
        slope_from = self._slope_from(level, compared)
        shares = slope_from is not level
        of_other = (Flag(SLOPE_FROM, values={"level": slope_from.name}), Flag(SERVES_TOO))
        rate = self.of_levels.rate(level)
        if shares and self.of_levels.settings["compare_basis"] == "raw":
            form, symbol, slope = "D = D_ref + k · (T - T_ref)", "k", self.of_levels.slope(slope_from)
        else:
            form, symbol, slope = "D = D_ref · [1 + κ · (T - T_ref)]", "κ", self.of_levels.relative_slope(slope_from)
        return Equation(
            id=f"{rate.id}/model",
            uut=rate.uut,
            quantity="rate",
            form=f"{level.name}: {form}",
            clauses=of_other if shares else (Flag(OWN_SLOPE),),
            constants={
                "D_ref": Constant(rate.value, rate.unit, rate.u),
                symbol: Constant(slope.value, slope.unit, slope.u),
                "T_ref": Constant(self.of_levels.reference_c, "°C", 0.0),
            },
            valid={"temperature_c": _ends(level.run.gates.converter_c)},
        )

    def _channel_model(self, drift: ChannelDrift) -> Equation:
        offset, scale = self._coefficients(drift)
        return Equation(
            id=f"{self.of_levels.id_of('tempco')}/model",
            uut=offset.uut,
            quantity="rate/temperature_coefficient",
            form="k = β + α · D",
            constants={
                "β": Constant(offset.value, offset.unit, offset.u),
                "α": Constant(scale.value, scale.unit, scale.u),
            },
            valid={
                "rate_pps" if self.of_levels.unit.is_counted else "output": _ends(
                    np.array([level.run.rate for level in self._usable])
                )
            },
        )


def _named(level: Level, other: Level, factor: float) -> list[BudgetLine]:
    """Contribution of a level to a deviation from another."""
    return [
        BudgetLine(f"{level.name}: {line.source}", line.type, line.u * factor, line.dof)
        for line in level.lines_beside(other)
    ]


def _ends(values: Array) -> tuple[float, float]:
    return float(np.min(values)), float(np.max(values))
