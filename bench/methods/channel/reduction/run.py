"""Method M0 on a run: a channel over the temperature of its converter at several input levels (equations 2).

Every level has a line of its own, D = D_ref + k (T - T_ref). If a run has several levels they are compared; their
slopes together determine the two temperature coefficients of the converter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.channel.reduction.across_levels import ChannelConclusions
from bench.methods.channel.reduction.compared_levels import (
    GRAVITY_REFERENCE,
    OWN_TEMPERATURE,
    SOURCE_REFERENCE,
    Compared,
    Level,
    compared_levels,
    drift_of_channel,
    has_drifted,
    lines_of_levels,
)
from bench.methods.channel.reduction.decision import ChannelDrift, out_of_proportion
from bench.methods.channel.reduction.findings import ChannelFindings
from bench.methods.channel.reduction.inertial import combined
from bench.methods.channel.reduction.inputs_seen import wrong_inputs
from bench.methods.channel.reduction.levels import levels_of
from bench.methods.channel.reduction.line import ABORT_SHARE
from bench.metrology.results.finding import NOT_CLOSED, Finding, UnitResult
from bench.metrology.results.flag import Flag, samples_left_out
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.unlike_nominal import flags_of_scale

LEFT_OUT = (
    "missing", "thermometer", "impossible_rate", "saturated", "stuck", "outlier", "ambiguous_gap",
    "accelerometer_temperature", "too_few_voltages", "too_few_codes", "irregular_clock",
)  # fmt: skip
ZERO_SHARE = 0.01  # of the rate at 1 g: maximum rate of a channel with zero input
# maximum difference by chance, in standard uncertainties of the stated and the determined value together
CONTRADICTS = 2.0


@dataclass(frozen=True, slots=True)
class ChannelDetail:
    """Data for the report: levels in run order and their comparisons; `span_s` is that of the run."""

    levels: tuple[Level, ...]
    compared: tuple[Compared, ...]
    reference_c: float
    threshold: float
    basis: str
    output_unit: str
    span_s: tuple[float, float] = (0.0, 0.0)


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to findings and models of every unit; `settings` are those of the method's description."""
    return [_of_unit(data, unit, settings) for unit in data.units]


def _of_unit(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    """Results of a unit; of an inertial unit those of its three accelerometer channels together."""
    if not unit.channels:
        return _reduced(data, unit, settings)
    wrong = wrong_inputs(data, unit)
    used = replace(data, acquisitions=tuple(each for each in data.acquisitions if each.step not in wrong))
    return combined(data, unit, {each.axis: _reduced(used, each, settings) for each in unit.accelerometers}, wrong)


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    found = levels_of(data, unit, settings)
    as_stated = lines_of_levels(data, unit, found, settings)
    by_name = with_own_drift(as_stated, settings["accelerometer_drift_u"])
    levels, compared = tuple(by_name.values()), tuple(compared_levels(by_name, settings))
    drift = drift_of_channel(levels)
    of_levels = ChannelFindings(data, unit, settings, found, levels)
    conclusions = ChannelConclusions(of_levels, compared, drift)
    left_out = [level.name for level in levels if not level.run.valid or _lost_its_thermostat(level)]
    left_out += [each.level.name for each in compared if each.comparison.decision == "invalid"]
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=tuple(_with_drift((*of_levels.findings(), *conclusions.findings()), levels, settings["drift_limit"])),
        models=tuple(conclusions.models()),
        compensations=tuple(conclusions.compensations()),
        left_out=tuple(dict.fromkeys(left_out)),
        flags=(
            *(flag for level in levels for flag in _flags_of_level(level, settings)),
            *(flag for each in compared for flag in _flags_of_comparison(each, settings)),
            *_flags_of_channel(of_levels, drift),
            *_flags_of_accelerometer(as_stated, settings["accelerometer_drift_u"]),
            *_flags_of_zero(of_levels),
        ),
        detail=ChannelDetail(
            levels,
            compared,
            settings["reference_temperature_c"],
            settings["threshold"],
            settings["compare_basis"],
            unit.output_unit,
            data.span_s,
        ),
    )


def _with_drift(findings: Sequence[Finding], levels: Sequence[Level], limit: float) -> Iterator[Finding]:
    """Findings with a flag on those of levels whose input drifted beyond its limit, and of all levels together."""
    drifted = {level.name for level in levels if has_drifted(level, limit)}
    for finding in findings:
        of = {finding.at["run"], finding.at.get("reference")} if "run" in finding.at else drifted
        yield finding if drifted.isdisjoint(of) else finding.flagged(NOT_CLOSED)


def _lost_its_thermostat(level: Level) -> bool:
    """True if the accelerometer was off its temperature for so much of the run that this should have ended."""
    away = level.run.excluded.get("accelerometer_temperature", 0)
    return away > ABORT_SHARE * (away + level.run.gates_used)


def _flags_of_level(level: Level, settings: Mapping[str, Any]) -> Iterator[Flag]:
    name, excluded = level.name, level.run.excluded
    yield from (Flag(code, of=name) for code in level.run.flags)
    yield from (replace(note, at=name) for note in level.run.notes)
    for reason in LEFT_OUT:
        if excluded.get(reason):
            yield samples_left_out(reason, excluded[reason], name)
    for point in level.data.points:
        yield from (Flag(problem, at=point.step) for problem in point.problems)
    if has_drifted(level, settings["drift_limit"]):
        yield Flag("input_drifted", of=name)
    if level.drift is None:
        yield Flag("no_points", of=name)


def _flags_of_comparison(compared: Compared, settings: Mapping[str, Any]) -> Iterator[Flag]:
    """Flags for the reason of a missing decision, and for a deviation on the deciding basis only."""
    name, found, threshold = compared.level.name, compared.comparison, settings["threshold"]
    yield from (Flag(remark, at=name) for remark in found.remarks)
    if found.decision == "invalid":
        return
    raw, normalised = found.raw.value <= threshold, found.normalised.value <= threshold
    if settings["compare_basis"] == "raw" and normalised and not raw:
        yield Flag("slope_follows_level", of=name)
    elif settings["compare_basis"] == "normalised" and raw and not normalised:
        yield Flag("slope_same_at_all_levels", of=name)


def _flags_of_channel(of_levels: ChannelFindings, drift: ChannelDrift | None) -> Iterator[Flag]:
    levels = of_levels.levels
    if not of_levels.unit.converter:
        yield Flag("no_thermometer", of="converter")
    if any(level.is_source for level in levels) and of_levels.certificate is None:
        yield Flag("not_certified", of=of_levels.standard)
    yield from of_levels.flags_of_currents()
    odd = out_of_proportion(
        np.array([level.data.level.level_g for level in levels]), np.array([level.run.rate for level in levels])
    )
    yield from (Flag("out_of_proportion", of=level.name) for level, is_odd in zip(levels, odd, strict=True) if is_odd)
    if drift is not None and drift.misfit:
        yield Flag("drift_not_linear", of="channel")
    by_gravity = [level for level in levels if not level.is_source and level.data.level.level_g]
    for level in by_gravity[:1]:
        yield from flags_of_scale(level.run.rate / level.data.level.level_g, 0.0, of_levels.unit)


def _flags_of_accelerometer(levels: Mapping[str, Level], stated_u: float) -> Iterator[Flag]:
    """Flags if the data contradict the stated drift of the accelerometer with its temperature."""
    drift = own_drift(levels)
    if drift is not None and drift.beyond(stated_u):
        yield Flag("accelerometer_drift", of=GRAVITY_REFERENCE)


def _flags_of_zero(of_levels: ChannelFindings) -> Iterator[Flag]:
    """Flags of points with the source at zero at which the channel counted as if it had an input."""
    per_g = [abs(each.run.rate / each.data.level.level_g) for each in of_levels.levels if each.is_source]
    for point in of_levels.zero_points:
        yield from (Flag(problem, at=point.step) for problem in point.problems)
        if per_g and abs(point.rate) > ZERO_SHARE * min(per_g):
            yield Flag("not_zero", at=point.step)


@dataclass(frozen=True, slots=True)
class OwnDrift:
    """Relative change per °C of an accelerometer's output with its own temperature, with its standard uncertainty."""

    per_c: float
    u_per_c: float

    def beyond(self, stated_u: float) -> bool:
        """True if it exceeds the stated standard uncertainty combined with its own."""
        return abs(self.per_c) > CONTRADICTS * float(np.hypot(stated_u, self.u_per_c))


def own_drift(levels: Mapping[str, Level]) -> OwnDrift | None:
    """Drift from levels at 1 g of gravity and of the source; None without both, or if its temperature is constant."""
    up, source = levels.get(GRAVITY_REFERENCE), levels.get(SOURCE_REFERENCE)
    if up is None or source is None or not up.scatter.accelerometer_per_c:
        return None
    apart = up.run.relative_slope_per_c - source.run.relative_slope_per_c
    drifted = _by_thermometer(up) - _by_thermometer(source)
    u = float(np.linalg.norm([_u_without(up), _u_without(source), drifted]))
    follows = abs(up.scatter.accelerometer_per_c)
    return OwnDrift(apart / follows, u / follows) if np.isfinite([apart, u]).all() else None


def _by_thermometer(level: Level) -> float:
    """Signed effect of one standard uncertainty of the thermometer drift on a relative slope."""
    return level.run.relative_slope_per_c * level.drifted_share


def _u_without(level: Level) -> float:
    """Standard uncertainty of a relative slope without the contribution of the accelerometer's own temperature."""
    parts = [line.u for line in level.slope_lines if line.kind != OWN_TEMPERATURE]
    return float(np.linalg.norm(parts) / abs(level.run.rate))


def with_own_drift(levels: Mapping[str, Level], stated_u: float) -> dict[str, Level]:
    """Levels with the uncertainty of gravity levels increased if the unit contradicts the stated drift.

    A drift above the stated standard uncertainty is no contradiction: every third conforming unit has one. Replacing
    the statement in these cases would overstate their uncertainty without improving any other.
    """
    found = own_drift(levels)
    if found is None or not found.beyond(stated_u):
        return dict(levels)
    return {name: level if level.is_source else _widened(level, abs(found.per_c)) for name, level in levels.items()}


def _widened(level: Level, per_c: float) -> Level:
    u = abs(level.run.rate * level.scatter.accelerometer_per_c) * per_c
    lines = [line._replace(u=u) if line.kind == OWN_TEMPERATURE else line for line in level.slope_lines]
    return replace(level, slope_lines=tuple(lines))
