"""Truth of simulated data, for truth.json: computed by the simulators, without code of the reduction."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from bench.app.truth import orientation
from bench.metrology.run_data import RunData, UnitUnderTest
from simulators.truth.constants import LegAsMeasured, noiseless_output
from simulators.world import World


def truth(data: RunData, world: World) -> Mapping[str, Any]:
    """Mean and relative drift of the noiseless output of each unit, by its place."""
    return {unit.place: _of(unit, data, world) for unit in data.units if unit.place in world.units}


def _of(unit: UnitUnderTest, data: RunData, world: World) -> Mapping[str, float]:
    if len(data.acquisitions) < 2:
        return {}
    readings = [
        LegAsMeasured(each.step, unit.place, each.begin_s, each.end_s, orientation(each)) for each in data.acquisitions
    ]
    output = np.array([noiseless_output(world, reading) for reading in readings])
    hours = np.array([world.true_time((each.begin_s + each.end_s) / 2) / 3600 for each in readings])
    slope_per_h = float(np.polyfit(hours - hours.mean(), output, 1)[0])
    return {"rest_mean": float(output.mean()), "rest_drift": slope_per_h / float(output.mean())}
