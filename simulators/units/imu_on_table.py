"""Sensors of an inertial unit on a rate table: accelerometers on arms of their own, with dynamic responses.

The three-axis table of a calibration turns a unit about its sensors, slowly; there neither matters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulators.physics.attitude import Vector, to_unit
from simulators.physics.dynamics import Follower, look_at_s, mean_input
from simulators.physics.table_kinematics import NOWHERE
from simulators.units.accelerometer import UnitTruth
from simulators.units.gyro import GyroTruth
from simulators.units.imu_drawn import ImuTruth
from simulators.units.imu_file import NAMES
from simulators.units.settings import ImuPlace
from simulators.units.surroundings import Surroundings

Array = NDArray[np.float64]
AXES = range(len(NAMES))


def is_on_table(truth: ImuTruth, settings: ImuPlace) -> bool:
    """True if arms or dynamic responses of the sensors matter."""
    return settings.arm_m != NOWHERE or any(each.dynamics is not None for each in _sensors(truth))


def _sensors(truth: ImuTruth) -> tuple[UnitTruth | GyroTruth, ...]:
    return (*truth.accelerometers, *truth.gyros)


class SensorsOnTable:
    """Six sensors that are followed between the latches; `settings.arm_m` is the reference point of the unit."""

    def __init__(self, truth: ImuTruth, settings: ImuPlace, world: Surroundings) -> None:
        self._truth, self._settings, self._world = truth, settings, world
        self._sensors = _sensors(truth)
        self._followers = [None if each.dynamics is None else Follower(each.dynamics) for each in self._sensors]

    def sensed(self, edges_s: Array, warm_c: tuple[Array, Array], drifting: tuple[Array, Array]) -> tuple[Array, Array]:
        """Mean currents of the accelerometers and mean pulse rates of the gyros between edges (n + 1,), (3, n) each.

        `warm_c` are the temperatures of accelerometers and gyros, (3, n) or (n,) if alike, `drifting` their biases in g
        and °/s (3, n).
        """
        found = np.empty((len(self._sensors), len(edges_s) - 1))
        for delay_s in dict.fromkeys(each.delay_s for each in self._sensors):
            rows = [row for row, each in enumerate(self._sensors) if each.delay_s == delay_s]
            look_s = look_at_s(edges_s, delay_s)
            at_s = look_s[:, :1] if self._world.kinematics.at_rest(look_s[0]) else look_s  # constant in an interval
            for row, output in zip(rows, self._outputs(rows, at_s, warm_c, drifting), strict=True):
                inputs, follower = np.broadcast_to(output.reshape(at_s.shape), look_s.shape), self._followers[row]
                found[row] = mean_input(inputs) if follower is None else follower.mean(inputs, np.diff(edges_s))
        return found[: len(NAMES)], found[len(NAMES) :]

    def _outputs(
        self, rows: Sequence[int], at_s: Array, warm_c: tuple[Array, Array], drifting: tuple[Array, Array]
    ) -> list[Array]:
        """Outputs of sensors before their dynamic responses, (n · p,) each, at times (n, p) in n intervals."""
        points, at_s = at_s.shape[1], at_s.ravel()
        world, into_unit = self._world, to_unit(self._world.mount, self._settings.mount_angle_deg)
        rate_dps = into_unit @ world.kinematics.rate_dps(at_s)
        forces_g = [into_unit @ each for each in world.kinematics.forces_g(at_s, [self._arm_m(row) for row in rows])]
        accelerometer_c, gyro_c = (
            np.broadcast_to(np.repeat(each, points, axis=-1), (len(NAMES), each.shape[-1] * points)) for each in warm_c
        )
        drifting_g, drifting_dps = (np.repeat(each, points, axis=1) for each in drifting)
        found = []
        for row, force_g in zip(rows, forces_g, strict=True):
            axis = row % len(NAMES)
            if row < len(NAMES):
                channel = self._truth.accelerometers[axis]
                found.append(channel.current_a(_along(force_g, axis), accelerometer_c[axis], drifting_g[axis]))
            else:
                rates, forces = _along(rate_dps, axis), _along(force_g, axis)
                found.append(self._truth.gyros[axis].output_pps(rates, forces, gyro_c[axis], drifting_dps[axis]))
        return found

    def _arm_m(self, row: int) -> Vector:
        """Position of a sensor relative to the axis of the table, in the frame of the fixture."""
        if row >= len(NAMES):
            return self._settings.arm_m
        into_unit = to_unit(self._world.mount, self._settings.mount_angle_deg)
        x_m, y_m, z_m = (into_unit.T @ np.array(self._truth.positions_m[row]) + self._settings.arm_m).tolist()
        return x_m, y_m, z_m


def _along(vectors: Array, axis: int) -> tuple[Array, Array, Array]:
    """Components (n,) along an axis and the two after it, of vectors (3, n)."""
    first, second, third = ((axis + shift) % len(NAMES) for shift in AXES)
    return vectors[first], vectors[second], vectors[third]
