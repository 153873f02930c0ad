"""What the accelerometer itself makes of the slopes of a channel, where it follows the chamber a little.

A budget states how much its output changes with its own temperature. A source at the same level has no accelerometer
behind it: by how much the two relative slopes differ tells whether the statement holds for this unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.channel.reduction.compared_levels import GRAVITY_REFERENCE, OWN_TEMPERATURE, SOURCE_REFERENCE, Level

CONTRADICTS = 2.0  # standard uncertainties, of what is stated and of what is found together, that chance is within


@dataclass(frozen=True, slots=True)
class OwnDrift:
    """Change of an accelerometer's output with its own temperature, relative, per °C, with its standard uncertainty."""

    per_c: float
    u_per_c: float

    def beyond(self, stated_u: float) -> bool:
        """Whether it is more than the stated standard uncertainty and its own let expect."""
        return abs(self.per_c) > CONTRADICTS * float(np.hypot(stated_u, self.u_per_c))


def own_drift(levels: Mapping[str, Level]) -> OwnDrift | None:
    """What 1 g of gravity and 1 g of the source tell; None without both, or where it does not follow at all."""
    up, source = levels.get(GRAVITY_REFERENCE), levels.get(SOURCE_REFERENCE)
    if up is None or source is None or not up.scatter.accelerometer_per_c:
        return None
    apart = up.run.relative_slope_per_c - source.run.relative_slope_per_c
    drifted = _by_thermometer(up) - _by_thermometer(source)
    u = float(np.linalg.norm([_u_without(up), _u_without(source), drifted]))
    follows = abs(up.scatter.accelerometer_per_c)
    return OwnDrift(apart / follows, u / follows) if np.isfinite([apart, u]).all() else None


def _by_thermometer(level: Level) -> float:
    """What a drift of one standard uncertainty of the thermometer makes of a relative slope, with its sign."""
    return level.run.relative_slope_per_c * level.drifted_share


def _u_without(level: Level) -> float:
    """Standard uncertainty of a relative slope without the part of the accelerometer's own temperature."""
    parts = [line.u for line in level.slope_lines if line.kind != OWN_TEMPERATURE]
    return float(np.linalg.norm(parts) / abs(level.run.rate))


def with_own_drift(levels: Mapping[str, Level], stated_u: float) -> dict[str, Level]:
    """The levels, those of gravity as uncertain as the unit shows itself to be, where that contradicts the statement.

    A drift of more than the stated standard uncertainty is no contradiction: every third unit that is as stated has
    one. If it took the place of the statement there, those would be stated too uncertain, and no other one less.
    """
    found = own_drift(levels)
    if found is None or not found.beyond(stated_u):
        return dict(levels)
    return {name: level if level.is_source else _widened(level, abs(found.per_c)) for name, level in levels.items()}


def _widened(level: Level, per_c: float) -> Level:
    u = abs(level.run.rate * level.scatter.accelerometer_per_c) * per_c
    lines = [replace(line, u=u) if line.kind == OWN_TEMPERATURE else line for line in level.slope_lines]
    return replace(level, slope_lines=tuple(lines))
