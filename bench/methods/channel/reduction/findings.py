"""Findings of a channel at each of its input levels, each with its budget.

A level is in local g: the rate at 1 g does not depend on the size of g, but on the level of the slab.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.channel.reduction.compared_levels import SCATTER, Level, resolution_of
from bench.methods.channel.reduction.levels import LevelData, Point
from bench.methods.channel.reduction.transfer_meter import believes_meter, standard_of
from bench.metrology.bench_uncertainty import SourceRecord
from bench.metrology.extremes import interval_of_largest
from bench.metrology.instrument import instrument_lines
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.finding import Finding
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

HOUR_S, MA_PER_A = 3600.0, 1e3
BEYOND_U = 3.0  # maximum difference of two certificates, in standard uncertainties
LAG = BudgetLine("read-outs: lag behind the thermometer, contained", "alias", 0.0)
ZERO = "src_0g"  # name of the points with the source at 0 A


@dataclass(frozen=True)
class ChannelFindings:
    """Findings of one unit: lines at its levels, their comparison, and the drift of the channel."""

    data: RunData
    unit: UnitUnderTest
    settings: Mapping[str, Any]
    found: Mapping[str, LevelData]
    levels: Sequence[Level]

    def findings(self) -> Iterator[Finding]:
        """All findings that a limit may name, level by level, then those with zero input."""
        for level in self.levels:
            if np.isfinite(level.run.slope_per_c):
                yield self.rate(level)
                yield self.slope(level)
                yield self.relative_slope(level)
                yield from self._residual(level)
                yield from self._input_drift(level)
                yield from self._currents(level)
        yield from self._zero()

    # One level

    def rate(self, level: Level) -> Finding:
        """Rate at the reference temperature."""
        run, name = level.run, f"{self.output} at {self.reference_c:g} °C"
        gain, offset = self._thermometer
        rate, slope = abs(run.rate), abs(run.slope_per_c)
        lines = [
            BudgetLine(SCATTER, "A", level.scatter.scatter_rate, level.scatter.dof),
            BudgetLine(resolution_of(self.unit), "B", level.scatter.counting_rate),
            *instrument_lines(self.unit, self.data.bench, rate, 1.0),
            offset.times(slope),
            gain.times(slope).times(self.reference_c),
            *self._input_lines(level),
            *(line.times(self._away_c(level)) for line in level.input_lines),
            self.drift_line(slope * level.drifted_c),
            LAG,
        ]
        return self._of_level("rate", name, level, run.rate, self.unit.output_unit, lines)

    def _away_c(self, level: Level) -> float:
        """Reference temperature minus the middle of a run; through it, errors of the slope enter the rate."""
        return abs(self.reference_c - float(np.mean(level.run.gates.converter_c)))

    def _input_lines(self, level: Level) -> Iterator[BudgetLine]:
        """Uncertainty of the input of a level: the source by its certificate, gravity by the level of the slab."""
        rate, at = abs(level.run.rate), level.data.level
        if not level.is_source:
            tilt, level_g = self.data.bench.level.u, abs(at.level_g)
            tilted_g = np.hypot(np.sqrt(max(1 - level_g**2, 0.0)) * tilt, level_g * tilt**2 / np.sqrt(2))
            yield common("fixture: level", rate * tilted_g / level_g)
        elif self.certificate is not None:
            source = self.standard
            gain, offset = self.data.bench.current(source)
            drifted = level.drift_u_per_h * self._hours_of_run(level)
            yield from (gain.times(rate), offset.times(rate / at.current_a))
            yield BudgetLine(f"{source}: drift since the run began", "B", rate * drifted, None, f"{source}.drift")
        if level.is_source and level.data.metered is not None and believes_meter(self.unit, self.settings):
            scatter = level.data.metered.mean_u_a / abs(at.current_a)
            yield BudgetLine(f"{self.standard}: scatter of the mean", "A", rate * scatter)

    def _hours_of_run(self, level: Level) -> float:
        """Time (h) from the first point of the run, at any level, to the middle of the ramp.

        The certificate applies to a source that has just warmed up: it drifts also while levels of gravity are
        measured.
        """
        first, times_s = self.data.acquisitions[0], level.run.gates.time_s
        return (float(np.mean(times_s)) - min((first.begin_s + first.end_s) / 2, float(times_s[0]))) / HOUR_S

    def slope(self, level: Level) -> Finding:
        """Change of the rate with the temperature of the converter."""
        slope = level.run.slope_per_c
        lines = [*level.slope_lines, self.thermometer_gain(slope), self.drift_line(slope * level.drifted_share), LAG]
        unit = f"{self.unit.output_unit}/°C"
        return self._of_level("rate/temperature_coefficient", "slope", level, slope, unit, lines)

    def relative_slope(self, level: Level) -> Finding:
        """The same, relative to the rate."""
        slope, rate = level.run.relative_slope_per_c, abs(level.run.rate)
        lines = [
            *(line.times(1 / rate) for line in level.slope_lines), self.thermometer_gain(slope),
            self.drift_line(slope * level.drifted_share), LAG,
        ]  # fmt: skip
        name = f"slope relative to the {self.output}"
        return self._of_level("rate/relative_temperature_coefficient", name, level, slope, "1/°C", lines)

    def thermometer_gain(self, slope: float) -> BudgetLine:
        """Effect of the gain of the thermometer on a slope, common to all levels."""
        return self._thermometer[0].times(slope)

    def drift_line(self, u: float) -> BudgetLine:
        """Line for the drift of the thermometer within the run."""
        return DriftInRun(self.data, self.unit.converter).line(u)

    def _residual(self, level: Level) -> Iterator[Finding]:
        scatter, rate = level.scatter, abs(level.run.rate)
        if not len(scatter.residuals):
            return
        residuals = scatter.residuals / rate
        value = float(np.max(np.abs(residuals)))
        u = scatter.stretch_u / rate
        name = "largest departure from the line, of means over a twenty-fourth of the run"
        lines = [BudgetLine("read-outs: scatter of a mean", "A", u, scatter.dof)]
        found = self._of_level("rate/model_residual", name, level, value, "1", lines)
        yield replace(found, interval=interval_of_largest(residuals, u))

    def _input_drift(self, level: Level) -> Iterator[Finding]:
        drift = level.drift
        if drift is None:
            return
        name = f"change between the first and the last point at rest, {drift.hours:.1f} h apart"
        what = "points: scatter and resolution of the count" if self.unit.is_counted else "points: scatter"
        lines = [BudgetLine(what, "A", drift.scatter_u), self.drift_line(drift.thermometer_u)]
        yield self._of_level("rate/drift", name, level, drift.change, "1", lines, steps=drift.steps)

    def _currents(self, level: Level) -> Iterator[Finding]:
        """Current by the ammeter in the cable, and its deviation from that of the source."""
        read, meter = level.data.metered, self.unit.ammeter
        if read is None or not read.is_enough:
            return
        source_a = level.data.level.source_a
        gain, offset = self.data.bench.current(meter)
        lines = [BudgetLine(f"{meter}: scatter of the mean", "A", read.mean_u_a), gain.times(read.mean_a), offset]
        name = f"mean by the ammeter; the source says {MA_PER_A * source_a:.7g} mA"
        yield self._of_level("current", name, level, read.mean_a, "A", lines)
        relative = [line.times(1 / abs(source_a)) for line in lines]
        name = "of the ammeter from what the source says, corrected by its certificate"
        yield self._of_level("current/deviation", name, level, read.mean_a / source_a - 1, "1", relative)

    def flags_of_currents(self) -> Iterator[Flag]:
        """Flags of levels without ammeter readings, and of those where source and ammeter contradict certificates."""
        certified = [self.data.bench.sources.get(role) for role in (self.unit.source, self.unit.ammeter)]
        for level in self.levels:
            read = level.data.metered
            if read is None or not level.data.level.source_a:
                continue
            if not read.is_enough:
                yield Flag("ammeter_missing", of=level.name)
            elif all(certified):
                source_a = level.data.level.source_a
                u_a = np.linalg.norm(
                    [read.mean_u_a, *(known.u_a(source_a) for known in certified if known is not None)]
                )
                if abs(read.mean_a - source_a) > BEYOND_U * u_a:
                    yield Flag("source_and_ammeter_differ", of=level.name)

    # Zero input

    def _zero(self) -> Iterator[Finding]:
        points = [point for point in self.zero_points if not point.problems]
        if not points or not np.isfinite(self._zero_a):
            return
        at = {"run": ZERO}
        first, last = points[0], points[-1]
        _, offset = self.data.bench.current(self.standard)
        fed = self._output_per_a * self._zero_a
        lines = [
            *self._point_lines(first),
            *(() if self.unit.is_counted else instrument_lines(self.unit, self.data.bench, first.rate, 1.0)),
            offset.times(self._output_per_a),
        ]
        unit = self.unit.output_unit
        name = f"{self.output} with the source at 0 A"
        yield self.finding("zero", name, at, first.rate - fed, unit, lines, (first.step,))
        if last is not first:
            hours = (last.middle_s - first.middle_s) / HOUR_S
            name = f"change of the {self.output} at 0 A within {hours:.1f} h"
            lines = self._point_lines(first, last)
            change = last.rate - first.rate
            yield self.finding("zero/drift", name, at, change, unit, lines, (first.step, last.step))

    @property
    def zero_points(self) -> Sequence[Point]:
        """Points at which the source was set to zero."""
        level = self._zero_level
        return level.points if level is not None else ()

    @property
    def _zero_a(self) -> float:
        """Current of the source by its certificate when set to zero."""
        return self._zero_level.level.current_a if self._zero_level is not None else 0.0

    @property
    def _zero_level(self) -> LevelData | None:
        sources = (each for each in self.found.values() if each.level.kind == "source")
        return next((each for each in sources if each.level.set_g == 0), None)

    def _point_lines(self, *points: Point) -> list[BudgetLine]:
        """Uncertainty of points by themselves, or of their difference."""
        alone = float(np.linalg.norm([each.single_u for each in points]))
        steps = float(np.linalg.norm([each.quantisation_u for each in points]))
        if self.unit.is_counted:
            return [BudgetLine(resolution_of(self.unit), "B", alone)]
        return [BudgetLine(SCATTER, "A", alone), BudgetLine(resolution_of(self.unit), "B", steps)]

    @property
    def _output_per_a(self) -> float:
        """Scale factor of the converter, from its rate at a current."""
        found = [abs(level.run.rate / level.data.level.current_a) for level in self.levels if level.is_source]
        found = [each for each in found if np.isfinite(each)]
        return float(np.median(found)) if found else 0.0

    # Parts of findings

    @property
    def output(self) -> str:
        """Name of the output for people."""
        return "rate" if self.unit.is_counted else "output"

    @property
    def reference_c(self) -> float:
        """Temperature of the converter to which rates refer."""
        return float(self.settings["reference_temperature_c"])

    @property
    def _thermometer(self) -> tuple[BudgetLine, BudgetLine]:
        """Errors of the thermometer at the converter: of its gain and of its offset."""
        return self.data.bench.thermometer(self.unit.converter)

    @property
    def standard(self) -> str:
        """Role of the current standard: the source, or the ammeter in its cable."""
        return standard_of(self.unit, self.settings)

    @property
    def certificate(self) -> SourceRecord | None:
        """Certificate of the standard."""
        return self.data.bench.sources.get(self.standard)

    def id_of(self, quantity: str) -> str:
        """First part of the id of a finding."""
        return self.data.subject(self.unit).id(quantity)

    def _of_level(
        self,
        quantity: str,
        name: str,
        level: Level,
        value: float,
        unit: str,
        lines: Sequence[BudgetLine],
        steps: tuple[str, ...] = (),
    ) -> Finding:
        fed = level.data.level
        at = {"run": level.name, "level_g": fed.level_g, **({"current_a": fed.current_a} if level.is_source else {})}
        return self.finding(quantity, name, at, value, unit, lines, steps or level.data.steps)

    def finding(
        self,
        quantity: str,
        name: str,
        at: Mapping[str, Any],
        value: float,
        unit: str,
        lines: Sequence[BudgetLine],
        steps: tuple[str, ...],
        flags: tuple[str, ...] = (),
    ) -> Finding:
        """One finding, with the lines of its budget that contribute."""
        at = {"axis": self.unit.axis, **at} if self.unit.sensor else at
        where = f"@{at['run']}" if "run" in at else ""
        return self.data.subject(self.unit).finding(quantity, name, value, unit, lines, at, steps, where, flags)
