"""Input levels of one run: each with its line and its uncertainty, and the decisions on shared models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.channel.reduction.decision import (
    Basis,
    ChannelDrift,
    Comparison,
    Decision,
    channel_drift,
    compare,
)
from bench.methods.channel.reduction.input_drift import InputDrift, drifts_of_sources, input_drift
from bench.methods.channel.reduction.levels import LevelData
from bench.methods.channel.reduction.line import ChannelRules, ChannelRun, reduce_run
from bench.methods.channel.reduction.means import Means, reduce_means
from bench.methods.channel.reduction.transfer_meter import believes_meter, standard_of
from bench.metrology.gate_scatter import LineScatter, line_gains, line_scatter
from bench.metrology.instrument import STEPS
from bench.metrology.least_squares import NotDetermined
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.coverage import COVERAGE, effective_dof
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

GRAVITY_REFERENCE, SOURCE_REFERENCE = "up_1g", "src_1g"
GAP_GATES = 1.5  # a longer interval between two read-outs was not recorded
READ_OUT, OWN_TEMPERATURE = "read_out", "own_temperature"  # kinds of lines
SCATTER, COUNTING = "read-outs: scatter", "read-outs: resolution of the count"


def resolution_of(unit: UnitUnderTest) -> str:
    """Name of the source of uncertainty for the resolution of a mean output."""
    return COUNTING if unit.telemetry is None else f"{unit.telemetry}{STEPS}"


@dataclass(frozen=True, slots=True)
class Level:
    """One input level: its line, the uncertainty of that, the drift of its input, and the drift assumed in budgets.

    `slope_lines` are the sources of uncertainty of its slope without the thermometer, in pulse/s/°C. A drift of one
    standard uncertainty of the thermometer within the run changes the temperature of its stated rate by `drifted_c`
    (°C), and its slope by the relative `drifted_share`.
    """

    data: LevelData
    run: ChannelRun
    scatter: LineScatter
    drift: InputDrift | None
    drift_u_per_h: float
    slope_lines: tuple[BudgetLine, ...]
    drifted_c: float = 0.0
    drifted_share: float = 0.0

    @property
    def name(self) -> str:
        """Name of the level."""
        return self.data.level.name

    @property
    def is_source(self) -> bool:
        """True if a current source is its input."""
        return self.data.level.kind == "source"

    @property
    def input_lines(self) -> list[BudgetLine]:
        """Lines of its slope that are due to its input."""
        return [line for line in self.slope_lines if line.kind != READ_OUT]

    @property
    def known_run(self) -> ChannelRun:
        """Its run with the whole uncertainty of the slope."""
        return self._run_known_by(self.slope_lines)

    def run_beside(self, other: Level) -> ChannelRun:
        """Its run with the uncertainty of the slope that it does not share with the other level."""
        return self._run_known_by(self.lines_beside(other))

    def lines_beside(self, other: Level) -> list[BudgetLine]:
        """Lines of its slope that it does not share with another level.

        An accelerometer that follows the chamber changes the rate in proportion at all levels of gravity.
        """
        theirs = {line.shared for line in other.slope_lines if line.shared}
        return [line for line in self.slope_lines if line.shared not in theirs]

    def _run_known_by(self, lines: Sequence[BudgetLine]) -> ChannelRun:
        return replace(
            self.run,
            u_slope_per_c=float(np.sqrt(sum(line.u**2 for line in lines))),
            dof_slope=effective_dof([(line.u, line.dof) for line in lines]),
        )


@dataclass(frozen=True, slots=True)
class Compared:
    """A level compared with its reference. `drifted` is true if the input of one of them drifted beyond its limit."""

    level: Level
    reference: Level
    comparison: Comparison
    drifted: bool

    @property
    def marginal(self) -> bool:
        """True if a repeated run might give another decision."""
        return self.comparison.decision != "invalid" and (self.comparison.marginal or self.drifted)

    def decided(self, basis: Basis) -> tuple[Decision, bool]:
        """Decision on one basis; true if a repeated run might give another."""
        decision, marginal, _ = self.comparison.decided[basis]
        return decision, decision != "invalid" and (marginal or self.drifted)


def channel_rules(data: RunData, unit: UnitUnderTest, kind: str, settings: Mapping[str, Any]) -> ChannelRules:
    """Requirements on a run by its kind of input."""
    counts = data.acquisitions[0].counts[unit.channel] if unit.is_counted else None
    return ChannelRules(
        reference_c=settings["reference_temperature_c"],
        counter_bits=counts.counter_bits if counts else 0,
        max_rate_pps=counts.max_rate_pps if counts else np.inf,
        accelerometer_c=settings["accelerometer_c"] if kind == "gravity" else None,
        accelerometer_tolerance_c=settings["accelerometer_tolerance_c"],
        max_ramp_c_per_h=settings["max_ramp_c_per_h"],
        min_span_c=settings["min_span_c"],
        longest_gate_s=GAP_GATES * settings["gate_s"],
    )


def lines_of_levels(
    data: RunData, unit: UnitUnderTest, found: Mapping[str, LevelData], settings: Mapping[str, Any]
) -> dict[str, Level]:
    """Levels that have a ramp, each with its line; not-a-number if the line is not determined."""
    ramped = {name: level for name, level in found.items() if level.steps}
    runs = {name: _run(each, channel_rules(data, unit, each.level.kind, settings)) for name, each in ramped.items()}
    scatters = {name: _scatter(run, settings["reference_temperature_c"]) for name, run in runs.items()}
    for name, each in ramped.items():
        if each.metered is not None and believes_meter(unit, settings):
            runs[name] = each.metered.without_drift(runs[name], settings["reference_temperature_c"])
    drifts = drifts_of_sources(
        ramped,
        {
            name: input_drift(ramped[name].points, runs[name], scatters[name], DriftInRun(data, unit.converter))
            for name in ramped
        },
    )
    return {
        name: _level(data, unit, ramped[name], runs[name], scatters[name], drifts[name], settings) for name in ramped
    }


def _run(level: LevelData, rules: ChannelRules) -> ChannelRun:
    return reduce_means(level.record, rules) if isinstance(level.record, Means) else reduce_run(level.record, rules)


def _level(
    data: RunData,
    unit: UnitUnderTest,
    level: LevelData,
    run: ChannelRun,
    scatter: LineScatter,
    drift: InputDrift | None,
    settings: Mapping[str, Any],
) -> Level:
    standard = standard_of(unit, settings)
    certificate = data.bench.sources.get(standard) if level.level.kind == "source" else None
    certified_per_h = certificate.drift_u_per_s * 3600.0 if certificate is not None else 0.0
    ramp_h = float(np.sum(run.gates.seconds)) / 3600.0
    found_per_h = drift.found_per_h(None if level.level.kind == "source" else ramp_h) if drift is not None else 0.0
    drift_u_per_h = found_per_h if found_per_h > COVERAGE * certified_per_h else certified_per_h
    rate = abs(run.rate)
    by_meter = level.metered is not None and believes_meter(unit, settings)
    what = standard if by_meter else "source" if level.level.kind == "source" else "accelerometer"
    lines = [
        BudgetLine(SCATTER, "A", scatter.scatter_slope, scatter.dof, kind=READ_OUT),
        BudgetLine(resolution_of(unit), "B", scatter.counting_slope, kind=READ_OUT),
        BudgetLine(f"{what}: drift during the ramp", "B", rate * drift_u_per_h * abs(scatter.drift_h_per_c)),
    ]
    if level.metered is not None and by_meter:
        drift_u = level.metered.change_per_c(run.gates)[1] if run.gates_used else np.nan
        lines.append(BudgetLine(f"{standard}: scatter", "A", rate * drift_u))
    if level.level.kind == "gravity":
        followed = abs(scatter.accelerometer_per_c) * settings["accelerometer_drift_u"]
        own = f"{unit.place}.accelerometer"
        lines.append(BudgetLine("accelerometer: its own temperature", "B", rate * followed, None, own, OWN_TEMPERATURE))
    return Level(level, run, scatter, drift, drift_u_per_h, tuple(lines), *_drifted(data, unit, run, settings))


def _drifted(data: RunData, unit: UnitUnderTest, run: ChannelRun, settings: Mapping[str, Any]) -> tuple[float, float]:
    """Effect of the drift of the thermometer on a line: in °C at the reference, and relative to its slope."""
    converter_c = run.gates.converter_c
    if not len(converter_c) or not np.ptp(converter_c):
        return 0.0, 0.0
    slope_gain, rate_gain = line_gains(converter_c, settings["reference_temperature_c"])
    error_c = DriftInRun(data, unit.converter).error_c(run.gates.time_s)
    return float(rate_gain @ error_c), float(slope_gain @ error_c)


def _scatter(run: ChannelRun, reference_c: float) -> LineScatter:
    """Scatter of a line; for a short run, from the residuals of its gates."""
    try:
        return line_scatter(run.gates, reference_c)
    except NotDetermined:
        dof = max(run.gates_used - 2, 1)
        return LineScatter(
            0.0, 0.0, run.u_rate, run.u_slope_per_c, dof, run.residual_rms, np.nan, np.empty(0), np.nan,
            0.0, 0.0,
        )  # fmt: skip


def compared_levels(levels: Mapping[str, Level], settings: Mapping[str, Any]) -> Iterator[Compared]:
    """Compare every level with its reference, if the run has it (equations 2.5, step 6)."""
    for level in levels.values():
        reference = levels.get(reference_of(level, levels, settings["reference_policy"]))
        if reference is None or reference is level:
            continue
        comparison = compare(
            level.run_beside(reference), reference.run_beside(level),
            threshold=settings["threshold"], basis=settings["compare_basis"],
        )  # fmt: skip
        drifted = any(has_drifted(each, settings["drift_limit"]) for each in (level, reference))
        yield Compared(level, reference, comparison, drifted)


def reference_of(level: Level, levels: Mapping[str, Level], policy: str) -> str:
    """Name of the reference of a level; a run of the source alone has its own."""
    of_source = level.is_source and level.name != SOURCE_REFERENCE
    by_source = policy == "embodiment" or GRAVITY_REFERENCE not in levels
    return SOURCE_REFERENCE if of_source and by_source else GRAVITY_REFERENCE


def has_drifted(level: Level, limit: float) -> bool:
    """True if the input changed by more than permitted between the points at rest."""
    return level.drift is not None and abs(level.drift.change) > limit


def drift_of_channel(levels: Sequence[Level]) -> ChannelDrift | None:
    """Line through the slopes of levels over their rates; None if the levels do not determine it."""
    usable = [level.known_run for level in levels if level.run.valid]
    if len(usable) < 2:
        return None
    try:
        return channel_drift(usable)
    except NotDetermined:
        return None
