"""An acquisition during a temperature ramp, cut into samples: an output and a temperature each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bench.analysis.counts import mean_rate
from bench.analysis.rundata import Acquisition, Array, Counts, UnitUnderTest, Voltages

NO_VOLTAGES = Voltages(np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class RampLeg:
    """The samples of one acquisition, (n,) each; what could not be read is not-a-number. `output` is in pulse/s or V.

    `direction` is that of the chamber's set point: 1 rising, -1 falling, 0 for an acquisition that is no leg.
    `problems` tells how many samples were left out for which reason, with the flags of `mean_rate`.
    """

    step: str
    cycle: int
    direction: int
    angle_rad: float
    time_s: Array
    temperature_c: Array
    output: Array
    problems: Mapping[str, int]

    @property
    def name(self) -> str:
        """As a record of a ramp calls it."""
        return "up" if self.direction > 0 else "down"

    @property
    def path(self) -> str:
        """The loops around its acquisition: `position=0/cycle=1/end=80`."""
        return self.step.partition("/")[2].rpartition("/")[0]


def cut_into_samples(acquisition: Acquisition, unit: UnitUnderTest, angle_rad: float, sample_s: float) -> RampLeg:
    """The samples of `sample_s` of one acquisition, of which the last one may be missing.

    A temperature is the mean of the reading in between.
    """
    begins_s = np.arange(acquisition.begin_s, acquisition.end_s, sample_s)
    if unit.voltmeter is None:
        edges_s, output, problems = _rates(acquisition.counts[unit.channel], begins_s)
    else:
        edges_s, output, problems = _voltages(acquisition.voltages.get(unit.voltmeter, NO_VOLTAGES), begins_s)
    temperature_c = means_between(
        acquisition.temperatures_at_s[unit.temperature], acquisition.temperatures_c[unit.temperature], edges_s
    )
    problems["no_temperature"] += int(np.count_nonzero(np.isnan(temperature_c) & np.isfinite(output)))
    return RampLeg(
        step=acquisition.step,
        cycle=int(acquisition.loops.get("cycle", 1)),
        direction=int(np.nan_to_num(np.sign(acquisition.set_c - acquisition.set_from_c))),
        angle_rad=angle_rad,
        time_s=(edges_s[:-1] + edges_s[1:]) / 2,
        temperature_c=temperature_c,
        output=output,
        problems={problem: count for problem, count in problems.items() if count},
    )


def _rates(counts: Counts, begins_s: Array) -> tuple[Array, Array, Counter[str]]:
    """Edges of the samples, the rate in each, and what is wrong with how many.

    A rate goes from the first latch after the beginning of a sample to the first after its end, so that consecutive
    samples share a latch and nothing is lost between them.
    """
    latches = np.searchsorted(counts.host_s, begins_s)
    latches = latches[latches < len(counts.host_s)]
    rates = [mean_rate(counts.part(first, last)) for first, last in pairwise(latches.tolist())]
    problems = Counter(problem for rate in rates for problem in rate.problems)
    return counts.host_s[latches], np.array([np.nan if rate.problems else rate.net_pps for rate in rates]), problems


def _voltages(read: Voltages, begins_s: Array) -> tuple[Array, Array, Counter[str]]:
    """Edges of the samples, the mean voltage over the time of each, and how many have none."""
    output = means_between(read.at_s, read.values_v, begins_s)
    return begins_s, output, Counter(too_few_voltages=int(np.count_nonzero(np.isnan(output))))


def means_between(at_s: Array, values: Array, edges_s: Array) -> Array:
    """The mean over time of the values between each two consecutive edges; not-a-number where there is none.

    They change in between, so that it matters when a reading was taken.
    """
    known = np.isfinite(values)
    at_s, values = at_s[known], values[known]
    if len(at_s) < 2:
        return np.full(max(len(edges_s) - 1, 0), np.nan)
    area = np.concatenate(([0.0], np.cumsum(np.diff(at_s) * (values[1:] + values[:-1]) / 2)))
    inside_s = np.clip(edges_s, at_s[0], at_s[-1])
    span_s = np.diff(inside_s)
    is_read = (np.diff(np.searchsorted(at_s, edges_s)) > 0) & (span_s > 0)
    return np.where(is_read, np.diff(np.interp(inside_s, at_s, area)) / np.where(is_read, span_s, 1.0), np.nan)
