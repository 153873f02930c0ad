"""The output of a unit over an acquisition, whatever measured it: a pulse rate, or the mean of voltages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.counts import RESOLUTION_COUNTS, mean_rate
from bench.analysis.rundata import Acquisition, UnitUnderTest, Voltages

FEWEST_VOLTAGES = 2  # which a scatter needs


@dataclass(frozen=True, slots=True)
class Output:
    """A mean output in pulse/s or V; `problems` make it unusable.

    `alone_u` is what it alone tells of its standard uncertainty: the resolution of the count, or the scatter of the
    voltmeter's readings.
    """

    value: float
    alone_u: float
    problems: tuple[str, ...]


def mean_output(acquisition: Acquisition, unit: UnitUnderTest) -> Output:
    """The output of a unit, in its unit; NaN where nothing was measured.

    Problems: those of `mean_rate`, and too_few_voltages.
    """
    if unit.voltmeter is not None:
        return _mean_voltage(acquisition.voltages.get(unit.voltmeter))
    rate = mean_rate(acquisition.counts[unit.channel])
    return Output(rate.net_pps, RESOLUTION_COUNTS / (acquisition.end_s - acquisition.begin_s), rate.problems)


def _mean_voltage(read: Voltages | None) -> Output:
    if read is None or len(read.values_v) < FEWEST_VOLTAGES:
        return Output(float("nan"), float("nan"), ("too_few_voltages",))
    scatter_v = float(np.std(read.values_v, ddof=1) / np.sqrt(len(read.values_v)))
    return Output(float(np.mean(read.values_v)), scatter_v, ())
