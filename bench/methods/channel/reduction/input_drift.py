"""Drift of the input of a channel while its converter was warmed: by points at rest, and by certificate."""

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
    """A relative change of the rate from the first point at rest to the last, `hours` apart.

    `scatter_u` is its standard uncertainty from the scatter of the points, `thermometer_u` that from the drift of the
    thermometer. Points at another temperature than the first are corrected to that one by the line.
    """

    change: float
    scatter_u: float
    thermometer_u: float
    hours: float
    steps: tuple[str, ...]

    def found_per_h(self, ramp_h: float | None) -> float:
        """Drift rate as a standard uncertainty (1/h); 0 if it may be scatter or the thermometer.

        Without `ramp_h` a linear drift is assumed, as of a source. An accelerometer may have drifted completely, or not
        at all, during the ramp of that duration.
        """
        if abs(self.change) <= SIGNIFICANT_U * np.hypot(self.scatter_u, self.thermometer_u) or ramp_h == 0:
            return 0.0
        return abs(self.change) / (self.hours if ramp_h is None else np.sqrt(3) * ramp_h)


def input_drift(
    points: Sequence[Point], run: ChannelRun, scatter: LineScatter, thermometer: DriftInRun
) -> InputDrift | None:
    """Drift of a level between its first and its last point; None without two usable points."""
    usable = [point for point in points if not point.problems and point.span_s > 0]
    if len(usable) < 2 or not run.rate_pps:
        return None
    first, last = usable[0], usable[-1]
    warmed_pps = run.slope_pps_per_c * (last.converter_c - first.converter_c)
    u_pps = (scatter.mean_u_pps(first.span_s) ** 2 + scatter.mean_u_pps(last.span_s) ** 2) ** 0.5
    began_c, ended_c = thermometer.error_c(np.array([first.middle_s, last.middle_s]))
    return InputDrift(
        change=(last.rate_pps - first.rate_pps - warmed_pps) / run.rate_pps,
        scatter_u=u_pps / abs(run.rate_pps),
        thermometer_u=abs(run.relative_slope_per_c * (ended_c - began_c)),
        hours=(last.middle_s - first.middle_s) / HOUR_S,
        steps=(first.step, last.step),
    )


def drifts_of_sources(
    levels: Mapping[str, LevelData], drifts: Mapping[str, InputDrift | None]
) -> Mapping[str, InputDrift | None]:
    """The same, with source levels without own points given the drift of the level monitored longest.

    A source drifts in proportion to its current, so that a point at 1 g applies to 12 g.
    """
    watched = [drift for name, drift in drifts.items() if drift and levels[name].level.kind == "source"]
    longest = max(watched, key=lambda drift: drift.hours, default=None)
    return {
        name: longest if drift is None and levels[name].level.kind == "source" else drift
        for name, drift in drifts.items()
    }
