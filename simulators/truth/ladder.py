"""Truth of staircases of small input steps: reference positions, and width of the dead band.

In g of input: the noiseless rate without the dead band, divided by the local scale factor. The output follows a step of
the input outside the dead band, so these values define the true threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.physics.attitude import to_unit
from simulators.truth.constants import Orientation
from simulators.world import World

Array = NDArray[np.float64]
STEP_DEG = np.array([-0.1, 0.0, 0.1])


@dataclass(frozen=True, slots=True)
class LadderAsMeasured:
    """A staircase: host time of its middle, and attitude of the unit at the position."""

    key: str
    place: str
    at_s: float
    orientation: Orientation


def ladders_record(world: World, ladders: Sequence[LadderAsMeasured]) -> dict[str, Any]:
    """Truth of each staircase by key; empty without one."""
    return {"ladders": {ladder.key: _ladder(world, ladder) for ladder in ladders}} if ladders else {}


def _ladder(world: World, ladder: LadderAsMeasured) -> dict[str, float]:
    """`reference_g` is the input at the reference position, `dead_band_g` the half width of the dead band.

    `K1` is the slope there in pulse/s/g.
    """
    truth = world.units[ladder.place].truth
    without = replace(truth, dead_band_a=0.0)
    force_g = _force_g(world, ladder)
    _, drifted_g, moving_g, sensor_c, *_ = _state(world, ladder)
    rate_pps = without.rate_pps(without.current_a(force_g, np.full(3, sensor_c), np.full(3, drifted_g + moving_g)))
    k1 = float((rate_pps[2] - rate_pps[0]) / (force_g[0][2] - force_g[0][0]))
    return {
        "reference_g": float(rate_pps[1]) / k1,
        "dead_band_g": truth.pulses_per_a * truth.dead_band_a / abs(k1),
        "K1": k1,
    }


def _state(world: World, ladder: LadderAsMeasured) -> list[float]:
    """State of the unit in the middle of the staircase, as a UnitState."""
    true_s = world.true_time(ladder.at_s)
    history = world.units[ladder.place].history.around(true_s, true_s)
    return [float(np.interp(true_s, history[:, 0], row)) for row in history.T]


def _force_g(world: World, ladder: LadderAsMeasured) -> tuple[Array, Array, Array]:
    """Specific force along input, pendulous and output axis, (3,): slightly below, at, and slightly above the position.

    Includes the systematic errors of the axes, and the level.
    """
    turned_deg = [STEP_DEG, *(np.zeros(3) for _ in ladder.orientation.angles_deg[1:])]
    angles_deg = [
        axis.lasting_deg(np.full(3, at_deg)) + turn_deg
        for axis, at_deg, turn_deg in zip(world.axes.values(), ladder.orientation.angles_deg, turned_deg, strict=True)
    ]
    upward = world.settings.fixture.to_fixture(angles_deg, world.settings.level_deg)[:, :, 2]
    settings = world.units[ladder.place].settings
    x, y, z = to_unit(ladder.orientation.mount, settings.mount_angle_deg, settings.clock_deg) @ upward.T
    return x, z, y
