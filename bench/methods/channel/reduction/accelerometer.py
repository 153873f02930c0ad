"""Contribution of the accelerometer itself to the slopes of a channel, if it partly follows the chamber.

A budget states the sensitivity of its output to its own temperature. A current source at the same level has no
accelerometer: the difference of the two relative slopes tests the statement for this unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.channel.reduction.compared_levels import GRAVITY_REFERENCE, OWN_TEMPERATURE, SOURCE_REFERENCE, Level

# maximum difference by chance, in standard uncertainties of the stated and the determined value together
CONTRADICTS = 2.0


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
    parts = [line.u for line in level.slope_lines if line.source != OWN_TEMPERATURE]
    return float(np.linalg.norm(parts) / abs(level.run.rate_pps))


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
    u = abs(level.run.rate_pps * level.scatter.accelerometer_per_c) * per_c
    lines = [replace(line, u=u) if line.source == OWN_TEMPERATURE else line for line in level.slope_lines]
    return replace(level, slope_lines=tuple(lines))
