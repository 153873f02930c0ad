"""Division of an acquisition during a temperature ramp into samples, each with output and temperature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.ramp.reduction.turns import on_its_way
from bench.metrology.acquisition import Acquisition, Array, Counts
from bench.metrology.outputs import means_between, measured, outputs_between
from bench.metrology.run_data import UnitUnderTest


@dataclass(frozen=True, slots=True)
class RampLeg:
    """Samples of one acquisition, (n,) each; unreadable ones are not-a-number. `output` is in its unit.

    `direction` is that of the chamber's set point: 1 rising, -1 falling, 0 for an acquisition that is no leg. Samples
    that are `counted` share a latch with their neighbours. `problems` counts the samples left out for each reason, with
    the flags of `mean_rate`.
    """

    step: str
    cycle: int
    direction: int
    angle_rad: float
    time_s: Array
    temperature_c: Array
    output: Array
    seconds: Array
    counted: bool
    problems: Mapping[str, int]

    def without_turns(self) -> RampLeg:
        """The leg without the turn-rounds of the unit's own temperature at its ends."""
        rows = on_its_way(self.time_s, self.temperature_c, falls=self.direction < 0)
        return replace(
            self, time_s=self.time_s[rows], temperature_c=self.temperature_c[rows], output=self.output[rows],
            seconds=self.seconds[rows],
        )  # fmt: skip

    @property
    def name(self) -> str:
        """Name of the leg in a record of a ramp."""
        return "up" if self.direction > 0 else "down"

    @property
    def path(self) -> str:
        """Loops around its acquisition: `position=0/cycle=1/end=80`."""
        return self.step.partition("/")[2].rpartition("/")[0]


def cut_into_samples(acquisition: Acquisition, unit: UnitUnderTest, angle_rad: float, sample_s: float) -> RampLeg:
    """Divide one acquisition into samples of `sample_s`; an incomplete last one is dropped.

    A temperature is the mean of the readings within the sample.
    """
    begins_s = np.arange(acquisition.begin_s, acquisition.end_s, sample_s)
    found = measured(acquisition, unit)
    edges_s, output, problems = outputs_between(found, begins_s)
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
        seconds=np.diff(edges_s),
        counted=isinstance(found, Counts),
        problems={problem: count for problem, count in problems.items() if count},
    )
