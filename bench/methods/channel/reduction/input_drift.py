"""How the input of a channel drifted while its converter was warmed: by points at rest, and by certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.channel.reduction.levels import LevelData, Point
from bench.methods.channel.reduction.line import ChannelRun
from bench.metrology.gate_scatter import LineScatter
from bench.metrology.thermometer_drift import DriftInRun

HOUR_S = 3600.0
SIGNIFICANT_U = 2.0


@dataclass(frozen=True, slots=True)
class InputDrift:
    """A change of the rate relative to it, from the first point at rest to the last, `hours` apart.

    `scatter_u` is its standard uncertainty by what the points scatter, and `thermometer_u` by the drift of the
    thermometer. Points at another temperature than the first are brought to that one by the line.
    """

    change: float
    scatter_u: float
    thermometer_u: float
    hours: float
    steps: tuple[str, ...]

    def found_per_h(self, ramp_h: float | None) -> float:
        """How fast it drifted, as a standard uncertainty; 0 where it may be scatter or the thermometer.

        Without `ramp_h` it drifted evenly, as a source does. An accelerometer may have done all of it, or nothing,
        during the ramp, which took so long.
        """
        if abs(self.change) <= SIGNIFICANT_U * np.hypot(self.scatter_u, self.thermometer_u) or ramp_h == 0:
            return 0.0
        return abs(self.change) / (self.hours if ramp_h is None else np.sqrt(3) * ramp_h)


def input_drift(
    points: Sequence[Point], run: ChannelRun, scatter: LineScatter, thermometer: DriftInRun
) -> InputDrift | None:
    """The drift of a level between its first point and its last; None without two that can be used."""
    usable = [point for point in points if not point.problems and point.span_s > 0]
    if len(usable) < 2 or not run.rate:
        return None
    first, last = usable[0], usable[-1]
    warmed = run.slope_per_c * (last.converter_c - first.converter_c)
    u = (scatter.mean_u(first.span_s) ** 2 + scatter.mean_u(last.span_s) ** 2) ** 0.5
    began_c, ended_c = thermometer.error_c(np.array([first.middle_s, last.middle_s]))
    return InputDrift(
        change=(last.rate - first.rate - warmed) / run.rate,
        scatter_u=u / abs(run.rate),
        thermometer_u=abs(run.relative_slope_per_c * (ended_c - began_c)),
        hours=(last.middle_s - first.middle_s) / HOUR_S,
        steps=(first.step, last.step),
    )


def drifts_of_sources(
    levels: Mapping[str, LevelData], drifts: Mapping[str, InputDrift | None]
) -> Mapping[str, InputDrift | None]:
    """The same, where a source level without points of its own has those of the level that was watched the longest.

    A source drifts in proportion to its current, so that a point at 1 g tells of 12 g.
    """
    watched = [drift for name, drift in drifts.items() if drift and levels[name].level.kind == "source"]
    longest = max(watched, key=lambda drift: drift.hours, default=None)
    return {
        name: longest if drift is None and levels[name].level.kind == "source" else drift
        for name, drift in drifts.items()
    }
