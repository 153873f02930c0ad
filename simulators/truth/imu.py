"""Truth of an inertial unit, in a file that no reduction reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simulators.units.imu import ImuState
from simulators.world import World


@dataclass(frozen=True, slots=True)
class WindowAsMeasured:
    """A window of a run: host time of its middle."""

    key: str
    place: str
    at_s: float


def imu_record(world: World, windows: Sequence[WindowAsMeasured]) -> dict[str, Any]:
    """Each inertial unit as drawn with the errors of its thermometers, and its state in the middle of each window.

    The state is that of an ImuState. For units that send codes also the decodings, by channel.
    """
    decodings = {name: imu.settings.decodings for name, imu in sorted(world.imus.items()) if imu.settings.decodings}
    names = {name: {channel: asdict(each) for channel, each in of.items()} for name, of in decodings.items()}
    return {
        "imus": {name: asdict(imu.truth) for name, imu in sorted(world.imus.items())},
        "thermometers": {
            name: {at: asdict(errors) for at, errors in imu.settings.thermometers.items()}
            for name, imu in sorted(world.imus.items())
        },
        "latitude_deg": world.settings.latitude_deg,
        "windows": _drifted(world, windows),
        **({"decodings": names} if names else {}),
    }


def _drifted(world: World, windows: Sequence[WindowAsMeasured]) -> dict[str, dict[str, list[float]]]:
    """Drift of the biases in the middle of each window, and temperatures of the sensors."""
    names = ("accelerometers_g", "gyros_dps", "moving_g", "sensors_c")
    found = {}
    for window in (each for each in windows if each.place in world.imus):
        true_s = world.true_time(window.at_s)
        of_unit = ImuState.of(world.imus[window.place].history.around(true_s, true_s))._asdict()
        found[window.key] = {
            name: [float(np.interp(true_s, of_unit["true_s"], each)) for each in of_unit[name]] for name in names
        }
    return found
