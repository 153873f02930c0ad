"""Inputs of an inertial unit as its outputs show them: the axis that was up, the channel that the source fed.

A person mounts the unit and plugs the cable, and the record holds what the prompt asked for. The outputs of all three
accelerometer channels, by their nominal scale factor, contradict a wrong mount or a wrong channel.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.methods.channel.words import ATTITUDE, NO_CHANNEL, OTHER_AXIS, OTHER_CHANNEL
from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.orientation import specific_force_g
from bench.metrology.outputs import mean_output
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, RunData, UnitUnderTest

LEAST_CURRENT_G = 0.5  # equivalent acceleration; below it, biases and accelerometers left connected look alike
LARGEST_TURN = np.cos(np.radians(20.0))  # of the vector seen: misalignment, tilt and scale factors turn it by less
SEEN = 0.5  # of the expected output, which nominal and actual scale factors of a type never differ by
LEAST_SEEN_G = 0.3  # of the vector of all three: less is no gravity


def wrong_inputs(data: RunData, unit: UnitUnderTest) -> Mapping[str, Flag]:
    """Acquisitions, by their steps, with another input than recorded, each with its flag.

    Empty for units without nominal data, and for outputs that are not known.
    """
    if not unit.nominal_per_g:
        return {}
    found = {each.step: _contradiction(data, unit, each) for each in data.acquisitions}
    return {step: flag for step, flag in found.items() if flag is not None}


def _contradiction(data: RunData, unit: UnitUnderTest, acquisition: Acquisition) -> Flag | None:
    channels = unit.accelerometers
    seen_g = np.array([mean_output(acquisition, each).value / (unit.nominal_per_g or np.nan) for each in channels])
    if not np.isfinite(seen_g).all():
        return None
    if acquisition.input == "source":
        return _of_source(acquisition, unit, seen_g)
    return _of_gravity(acquisition, specific_force_g(acquisition, unit, data.bench), seen_g)


def _of_gravity(acquisition: Acquisition, expected_g: Array, seen_g: Array) -> Flag | None:
    """Flag if the vector of gravity is turned, or reversed, against that of the recorded mount."""
    size_g = max(float(np.linalg.norm(seen_g)), LEAST_SEEN_G)
    if seen_g @ expected_g >= LARGEST_TURN * size_g * np.linalg.norm(expected_g):
        return None
    values = {"mount": acquisition.mount.name, "read": _in_words(seen_g)}
    axis = int(np.argmax(np.abs(seen_g)))
    if abs(seen_g[axis]) < LARGEST_TURN * size_g:
        return Flag(ATTITUDE, at=acquisition.step, values=values)
    return Flag(OTHER_AXIS, at=acquisition.step, values={**values, "axis": AXES[axis]})


def _of_source(acquisition: Acquisition, unit: UnitUnderTest, seen_g: Array) -> Flag | None:
    """Flag if the current of the source is not seen in the recorded channel."""
    sensors = [each.sensor for each in unit.accelerometers]
    level_g = acquisition.sources_a.get(unit.source, 0.0) / unit.scale_a_per_g
    if acquisition.input_channel not in sensors or not abs(level_g) >= LEAST_CURRENT_G:
        return None
    fed = np.abs(seen_g) >= SEEN * abs(level_g)
    if fed[sensors.index(acquisition.input_channel)]:
        return None
    values = {"channel": acquisition.input_channel, "level": f"{level_g:.4g}", "read": _in_words(seen_g)}
    if not fed.any():
        return Flag(NO_CHANNEL, at=acquisition.step, values=values)
    found = sensors[int(np.argmax(np.abs(seen_g)))]
    return Flag(OTHER_CHANNEL, at=acquisition.step, values={**values, "found": found})


def _in_words(seen_g: Array) -> str:
    return ", ".join(
        f"{axis} {value:.2f} g" for axis, value in zip(AXES, (np.round(seen_g, 2) + 0.0).tolist(), strict=True)
    )
