"""Truth of a channel whose converter is in the chamber, at one input level.

The noiseless output of the converter (rate, volts or codes) as a function of the temperature of an ideal thermometer
with the lag of the real one. Its input is held at its mean: that of the accelerometer at the ideal angle of its axis,
or the set current of the source. Changes of the input itself with temperature are an error of the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.truth.constants import Orientation, gravity_in_unit
from simulators.units.accelerometer_unit import SimulatedUnit
from simulators.world import World

Array = NDArray[np.float64]
EVERY_S = 10.0


@dataclass(frozen=True, slots=True)
class LevelAsMeasured:
    """An acquisition at one input level: host time of its ends, and attitude of the unit.

    `source_a` is the set current of the source; None for an accelerometer.
    """

    key: str
    place: str
    begin_s: float
    end_s: float
    orientation: Orientation
    source_a: float | None


def levels_record(world: World, levels: Sequence[LevelAsMeasured]) -> dict[str, Any]:
    """Part of a truth file for such acquisitions.

    `levels` are the acquisitions by key; `sources` and `converter_thermometers` the errors of the laboratory.
    """
    if not levels:
        return {}
    return {
        "levels": {level.key: _level(world, level) for level in levels if world.units[level.place].board.history},
        "sources": {role: asdict(feed.errors) for role, feed in sorted(world.sources.items())},
        "converter_thermometers": {
            name: asdict(place.converter_thermometer) for name, place in sorted(world.settings.places.items())
        },
    }


def _level(world: World, level: LevelAsMeasured) -> dict[str, Any]:
    unit = world.units[level.place]
    at_s = np.arange(world.true_time(level.begin_s), world.true_time(level.end_s), EVERY_S)
    history = np.array(unit.board.history)
    board_c, thermometer_c, sensor_c, drifted_g = (np.interp(at_s, history[:, 0], row) for row in history.T[1:])
    input_a = level.source_a
    if input_a is None:
        input_a = _accelerometer_a(world, unit, level.orientation, sensor_c, drifted_g)
    through = unit.settings.through
    output, digits = unit.truth.output(np.full_like(at_s, input_a), through, board_c), 6 if through is None else 10
    return {
        "temperature_c": np.round(thermometer_c, 5).tolist(),
        "rate_pps" if through is None else "output": np.round(output, digits).tolist(),
        "input_a": input_a,
        "accelerometer_c": float(np.mean(sensor_c)),
    }


def _accelerometer_a(
    world: World, unit: SimulatedUnit, orientation: Orientation, sensor_c: Array, drifted_g: Array
) -> float:
    """Mean current of the accelerometer, in the attitude stated in the bench file."""
    along, output, pendulous = gravity_in_unit(world, unit, orientation)
    force = tuple(np.full_like(sensor_c, g) for g in (along, pendulous, output))
    return float(np.mean(unit.truth.current_a((force[0], force[1], force[2]), sensor_c, drifted_g)))
