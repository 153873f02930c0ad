"""Reduction of readings at rest to the mean output and its drift, with uncertainties; README.md has the equations.

Arithmetic alone: numbers in, plain records out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from bench.metrology.instrument import instrument_u, shared_as
from bench.metrology.least_squares import Array, least_squares
from bench.metrology.outputs import mean_output
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest

CURVED = "toy_rest_curved"
TOO_FEW = "toy_rest_too_few_readings"
CURVED_BEYOND = 3.0  # standard uncertainties of the square term
S_PER_H = 3600.0


@dataclass(frozen=True, slots=True)
class Rest:
    """Line through readings (n,) over `time_h`, which is 0 in their middle; equations 1 to 4."""

    time_h: Array
    output: Array
    mean: float
    slope_per_h: float
    residuals: Array
    sd: float
    dof: int
    is_curved: bool

    @property
    def mean_u(self) -> float:
        """Standard uncertainty of the mean from the scatter of the readings (equation 3)."""
        return float(self.sd / np.sqrt(len(self.output)))

    @property
    def slope_u_per_h(self) -> float:
        """The same for the slope (equation 3)."""
        return float(self.sd / np.sqrt(np.sum(self.time_h**2)))


def line_of(time_s: Array, output: Array) -> Rest:
    """Fit the line through four readings or more."""
    time_h = (time_s - np.mean(time_s)) / S_PER_H
    ones = np.ones_like(time_h)
    line = least_squares(np.stack([ones, time_h], axis=-1), output)
    curve = least_squares(np.stack([ones, time_h, time_h**2 - np.mean(time_h**2)], axis=-1), output)
    square_u = curve.residual_sd * np.sqrt(curve.unscaled_covariance[2, 2])
    mean, slope = line.coefficients.tolist()
    return Rest(
        time_h, output, mean, slope, line.residuals, float(line.residual_sd), line.dof,
        is_curved=bool(abs(curve.coefficients[2]) > CURVED_BEYOND * square_u),
    )  # fmt: skip


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the mean output, its drift and its scatter of every unit."""
    return [_reduced(data, unit, settings["fewest"]) for unit in data.units]


def _reduced(data: RunData, unit: UnitUnderTest, fewest: int) -> UnitResult:
    outputs = {each.step: mean_output(each, unit) for each in data.acquisitions}
    flags = [f"{step}: {output.problems[0]}" for step, output in outputs.items() if output.problems]
    used = [each for each in data.acquisitions if not outputs[each.step].problems]
    if len(used) < fewest:
        return UnitResult(unit.place, unit.serial, (), (), ("all",), (*flags, TOO_FEW))
    middle_s = np.array([(each.begin_s + each.end_s) / 2 for each in used])
    rest = line_of(middle_s, np.array([outputs[each.step].value for each in used]))
    single_u = float(np.sqrt(np.mean([outputs[each.step].single_u ** 2 for each in used])))
    count, subject, size = len(used), data.subject(unit), abs(rest.mean)
    at = {"over_h": float(np.ptp(rest.time_h)), "readings": count}
    steps = tuple(each.step for each in used)
    own = BudgetLine("readings: scatter about the line", "A", rest.mean_u, rest.dof)
    if single_u > rest.sd:  # if readings agree by chance; otherwise their scatter contains their resolution
        own = BudgetLine("readings: resolution of each", "B", single_u / np.sqrt(count))
    of_instrument = [
        BudgetLine(source, "B", u, None, shared_as(source))
        for source, u in instrument_u(unit, data.bench, rest.mean, 1.0).items()
    ]
    per_mean = float(np.sqrt(count / np.sum(rest.time_h**2))) / size  # from u of the mean to that of the drift
    few = BudgetLine("readings: few readings", "A", rest.sd / size / np.sqrt(2 * rest.dof), rest.dof)
    findings = (
        subject.finding(
            "rest_mean", "mean output at rest", rest.mean, unit.output_unit, [own, *of_instrument], at, steps
        ),
        subject.finding(
            "rest_drift", "slope of the output, relative to its mean", rest.slope_per_h / rest.mean, "1/h",
            [own.times(per_mean)], at, steps, flags=(CURVED,) if rest.is_curved else (),
        ),
        subject.finding(
            "rest_scatter", "standard deviation of a reading about the line, relative", rest.sd / size, "1", [few],
            at, steps,
        ),
    )  # fmt: skip
    return UnitResult(unit.place, unit.serial, findings, (), (), tuple(flags), detail=rest)
