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
from simulators.units.accelerometer import Through, UnitTruth
from simulators.units.imu import ImuState
from simulators.units.imu_temperatures import CHANNELS
from simulators.units.unit_temperatures import Board
from simulators.world import World

Array = NDArray[np.float64]
EVERY_S = 10.0


@dataclass(frozen=True, slots=True)
class LevelAsMeasured:
    """An acquisition at one input level: host time of its ends, and attitude of the unit.

    `source_a` is the set current of the source; None for an accelerometer. `sensor` is the channel of an inertial unit,
    such as acc_x.
    """

    key: str
    place: str
    begin_s: float
    end_s: float
    orientation: Orientation
    source_a: float | None
    sensor: str = ""


def levels_record(world: World, levels: Sequence[LevelAsMeasured]) -> dict[str, Any]:
    """Part of a truth file for such acquisitions.

    `levels` are the acquisitions by key; `sources` and `converter_thermometers` the errors of the laboratory.
    """
    if not levels:
        return {}
    return {
        "levels": {level.key: _level(world, level) for level in levels if _board_of(world, level.place).history},
        "sources": {role: asdict(feed.errors) for role, feed in sorted(world.sources.items())},
        "converter_thermometers": {
            **{name: asdict(at.converter_thermometer) for name, at in sorted(world.settings.places.items())},
            **{name: asdict(at.converter_thermometer) for name, at in sorted(world.settings.imus.items())},
        },
    }


def _board_of(world: World, place: str) -> Board:
    return world.imus[place].board if place in world.imus else world.units[place].board


@dataclass(frozen=True, slots=True)
class _Channel:
    """A channel of a unit: the unit as drawn, the drift of its bias over true time, and its signal path."""

    truth: UnitTruth
    drifted: tuple[Array, Array]
    through: Through
    force_g: Array  # along its input, pendulous and output axes, (3,)


def _channel_of(world: World, level: LevelAsMeasured, board: Array) -> _Channel:
    """The channel of a unit at a level; `board` are the states of its board meanwhile."""
    if level.place in world.units:
        unit = world.units[level.place]
        along, output, pendulous = gravity_in_unit(world, unit, level.orientation)
        force_g = np.array([along, pendulous, output])
        return _Channel(unit.truth, (board[:, 0], board[:, -1]), unit.settings.through, force_g)
    imu = world.imus[level.place]
    axis = CHANNELS.index(level.sensor)
    known = ImuState.of(imu.history.around(world.true_time(level.begin_s), world.true_time(level.end_s)))
    upward = gravity_in_unit(world, imu, level.orientation)
    force_g = np.roll(upward, -axis)  # its pendulous and output axes are the next two
    through = imu.settings.decodings.get(level.sensor)
    return _Channel(imu.truth.accelerometers[axis], (known.true_s, known.accelerometers_g[axis]), through, force_g)


def _level(world: World, level: LevelAsMeasured) -> dict[str, Any]:
    begin_s, end_s = world.true_time(level.begin_s), world.true_time(level.end_s)
    at_s = np.arange(begin_s, end_s, EVERY_S)
    board = _board_of(world, level.place).history.around(begin_s, end_s)
    board_c, thermometer_c, sensor_c = (np.interp(at_s, board[:, 0], row) for row in board.T[1:4])
    channel = _channel_of(world, level, board)
    input_a = level.source_a
    if input_a is None:
        input_a = _accelerometer_a(channel, sensor_c, np.interp(at_s, *channel.drifted))
    through = channel.through
    output, digits = channel.truth.output(np.full_like(at_s, input_a), through, board_c), 6 if through is None else 10
    return {
        "temperature_c": np.round(thermometer_c, 5).tolist(),
        "rate_pps" if through is None else "output": np.round(output, digits).tolist(),
        "input_a": input_a,
        "accelerometer_c": float(np.mean(sensor_c)),
    }


def _accelerometer_a(channel: _Channel, sensor_c: Array, drifted_g: Array) -> float:
    """Mean current of the accelerometer, in the attitude stated in the bench file."""
    along, pendulous, output = (np.full_like(sensor_c, g) for g in channel.force_g)
    return float(np.mean(channel.truth.current_a((along, pendulous, output), sensor_c, drifted_g)))
