"""Acquisitions of a range test: those at rest, those at a rate, and the unusable ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bench.methods.rate_table.reduction.bias_at_rest import Rest, RestReading, fit_rest
from bench.methods.rate_table.reduction.intake import table_samples
from bench.methods.rate_table.reduction.samples import Steady, harmonics_u_dps, steady
from bench.methods.rate_table.reduction.temperatures import MeanTemperature, temperatures_c, warmed_c
from bench.metrology.pooled_scatter import Scatter, alike
from bench.metrology.pulse_counts import mean_rate
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

AT_REST_DPS = 0.01


@dataclass(frozen=True, slots=True)
class Turning:
    """One rate: command, and means of table and unit, corrected for the drift of the bias from its middle.

    `u_harmonics_dps` is the uncertainty of the table's rate from encoder errors over a turn. `temperature_c` is that of
    the unit, without the noise of its thermometer if the run permits.
    """

    step: str
    command_dps: float
    steady: Steady
    u_harmonics_dps: float
    temperature_c: float

    def on_rate(self, tolerance: float) -> bool:
        """True if the table turned at the commanded rate within the tolerance."""
        return bool(abs(self.steady.rate_dps - self.command_dps) <= tolerance * abs(self.command_dps))


@dataclass(slots=True)
class RangeBlocks:
    """Data of a unit in a range test. `left_out` are the paths of unusable acquisitions, `flags` give the reasons.

    `warmed_c` is the change of the temperature over its readings, 0 unless it is more than its thermometer may drift.
    """

    rest: Rest | None = None
    rest_steps: list[str] = field(default_factory=list)
    turning: list[Turning] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    flags: list[Flag] = field(default_factory=list)
    warmed_c: float = 0.0

    @property
    def bias(self) -> Steady:
        """Bias at rest."""
        if self.rest is None:
            raise ValueError("nothing was read at rest")
        return Steady(self.rest.value, self.rest.u, 0.0, 0.0, saturated=False, dof=self.rest.dof)

    def settle(
        self, at_rest: Sequence[RestReading], turning: Sequence[tuple[float, Turning]], *, axis_wobbles: bool = False
    ) -> None:
        """Takes the bias from readings at rest, and its change until their times from those at a rate.

        Each of the latter is as uncertain as all together tell, where they scatter alike.
        """
        if at_rest:
            self.rest = fit_rest(at_rest, axis_wobbles=axis_wobbles)
        self.turning = _of_one_scatter([_without_drift(at_s, each, self.rest) for at_s, each in turning])

    def leave_out(self, step: str, problems: Sequence[str]) -> None:
        """Leave out an unusable acquisition."""
        path = step.partition("/")[2]
        self.left_out.append(path)
        self.flags += [Flag(problem, at=step) for problem in problems]


def range_blocks(
    data: RunData, unit: UnitUnderTest, per_pulse: float, clip: float, *, feels_gravity: bool = False
) -> RangeBlocks:
    """Blocks of a unit in run order; the output is multiplied by `per_pulse`.

    An accelerometer senses gravity: at rest the wobble of the axis, and possibly nothing within the dead band of its
    converter.
    """
    found = RangeBlocks()
    at_rest: list[RestReading] = []
    turning: list[tuple[float, Turning]] = []
    warmth: dict[float, MeanTemperature] = {}  # by mid-time
    for acquisition in data.acquisitions:
        samples, motion = table_samples(acquisition, unit), acquisition.motion
        problems = list(samples.problems)
        counted = motion is None and feels_gravity and unit.is_counted
        if counted and "dead_band" in mean_rate(acquisition.counts[unit.channel]).problems:
            problems.append("dead_band")
        if problems:
            found.leave_out(acquisition.step, problems)
            continue
        read = steady(samples, per_pulse, clip)
        middle_s = (acquisition.begin_s + acquisition.end_s) / 2
        warmth[middle_s] = samples.temperature
        if motion is not None and motion.rate_dps is not None:
            u_dps = harmonics_u_dps(samples, data.bench.axis(motion.device).harmonics_u_deg)
            turning.append((middle_s, Turning(acquisition.step, motion.rate_dps, read, u_dps, samples.temperature_c)))
        elif motion is None and abs(read.rate_dps) < AT_REST_DPS:
            at_rest.append(RestReading(middle_s, acquisition.angle_deg, read.output, read.u_output, read.dof))
            found.rest_steps.append(acquisition.step)
        else:
            found.leave_out(acquisition.step, ["not_at_rest"])
    if at_rest:
        drift_c = DriftInRun(data, unit.temperature).error_c(np.array(list(warmth)))
        all_c = temperatures_c(list(warmth), list(warmth.values()), drift_c)
        as_warm_c = dict(zip(warmth, all_c.tolist(), strict=True))
        turning = [(at_s, replace(each, temperature_c=as_warm_c[at_s])) for at_s, each in turning]
        found.warmed_c = warmed_c(list(warmth), list(warmth.values()), drift_c)
        found.settle(at_rest, turning, axis_wobbles=feels_gravity)
    else:
        found.flags.append(Flag("rest_missing"))
        found.left_out += [each.step.partition("/")[2] for _, each in turning]
    return found


def _without_drift(at_s: float, turning: Turning, rest: Rest | None) -> Turning:
    change = rest.change(at_s) if rest is not None else 0.0
    return replace(turning, steady=replace(turning.steady, output=turning.steady.output - change))


def _of_one_scatter(turning: list[Turning]) -> list[Turning]:
    """The same with the pooled uncertainty, if the scatter agrees: it is one sensor at all rates."""
    together = alike([Scatter(each.steady.u_output, each.steady.dof) for each in turning])
    if together is None:
        return turning
    return [replace(each, steady=replace(each.steady, u_output=together.sd, dof=together.dof)) for each in turning]
