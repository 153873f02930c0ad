"""Kinematics of the table and its fixture: direction of up, angular rate, and specific force at a place.

f = up + (w x (w x r) + dw/dt x r) / g in local g, in the frame of the fixture (equations 8.1)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.physics.attitude import Fixture, Vector, turn
from simulators.physics.motion import Axis
from simulators.physics.servo import Loop, Ripple

Array = NDArray[np.float64]
EAST: Vector = (1.0, 0.0, 0.0)
EARTH_DPS = math.degrees(7.292115e-5)  # equations 1.1
NOWHERE: Vector = (0.0, 0.0, 0.0)
Stands = tuple[float | None, ...]
"""True angle of each axis, °; None for a moving axis."""


def earth_dps(latitude_deg: float) -> Array:
    """Earth rate in east, north and up, (3,)."""
    latitude = math.radians(latitude_deg)
    return np.asarray(EARTH_DPS * np.array([0.0, math.cos(latitude), math.sin(latitude)]))


@dataclass(frozen=True, slots=True)
class TableErrors:
    """Errors of a table.

    `rate` is the relative error of its rate. The base is tilted by `across_deg` about east, in addition to the level
    about south; the axis has a wobble of `wobble_deg` about south, once per turn.
    """

    loop: Loop | None = None
    ripple: Ripple | None = None
    rate: float = 0.0
    across_deg: float = 0.0
    wobble_deg: float = 0.0
    wobble_phase_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Level:
    """Tilt of the base about south: mean over a run of `run_s`, and linear change within it."""

    middle_deg: float = 0.0
    drift_deg: float = 0.0
    run_s: float = 0.0

    def at(self, at_s: float) -> float:
        """Tilt in degrees at a true time."""
        return self.middle_deg + (self.drift_deg * (at_s / self.run_s - 0.5) if self.run_s else 0.0)


class TableKinematics:
    """The fixture on its axes; vectors are (3, n) for n times."""

    def __init__(
        self,
        fixture: Fixture,
        axes: Mapping[str, Axis],
        *,
        level: Level,
        table: TableErrors,
        gravity_mps2: float,
        latitude_deg: float,
    ) -> None:
        self._fixture, self._axes, self._table = fixture, list(axes.values()), table
        self._level, self._gravity_mps2 = level, gravity_mps2
        self.earth_dps = earth_dps(latitude_deg)
        self._at_rest: tuple[Stands, Array] = (), np.empty((1, 3, 3))
        self._sweep: tuple[Stands, Array] = (), np.empty((3, 3, 3))

    def stands(self, at_s: float) -> Stands:
        """True angle of each axis."""
        return tuple(axis.still_deg(at_s) for axis in self._axes)

    def at_rest(self, at_s: Array) -> bool:
        """Return whether no axis moves."""
        return None not in self.stands(float(at_s[0]))

    def attitude(self, at_s: Array) -> Array:
        """Level frame to fixture, (n, 3, 3); (1, 3, 3) at rest. Between two moves the level is constant."""
        began_s = float(at_s[0])
        still_deg = self.stands(began_s)
        if self.sweeps(still_deg):
            waves = waves_of(self._axes[still_deg.index(None)].true_deg(at_s))
            return np.asarray((waves.T @ self.sweep(still_deg, began_s).reshape(3, 9)).reshape(-1, 3, 3))
        if None in still_deg:
            return self._turned([axis.true_deg(at_s) for axis in self._axes], began_s)
        if still_deg != self._at_rest[0]:
            self._at_rest = still_deg, self._turned([np.full(1, angle_deg) for angle_deg in still_deg], began_s)
        return self._at_rest[1]

    def upward(self, at_s: Array) -> Array:
        """Direction of up."""
        return np.broadcast_to(self.attitude(at_s)[:, :, 2].T, (3, len(at_s)))

    def force_g(self, at_s: Array, arm_m: Vector) -> Array:
        """Specific force in local g at a place, whose arm is from the intersection of the axes."""
        return self.forces_g(at_s, [arm_m])[0]

    def forces_g(self, at_s: Array, arms_m: Sequence[Vector]) -> list[Array]:
        """The same at several places."""
        up = self.upward(at_s)
        if self.at_rest(at_s) or all(arm_m == NOWHERE for arm_m in arms_m):
            return [up for _ in arms_m]
        velocity, change = self._turning(at_s)
        pulls = [np.cross(velocity, np.cross(velocity, arm_m)) + np.cross(change, arm_m) for arm_m in arms_m]
        return [np.asarray(up + pull.T / self._gravity_mps2) for pull in pulls]

    def rate_dps(self, at_s: Array) -> Array:
        """Angular rate in inertial space."""
        by_earth = np.broadcast_to((self.attitude(at_s) @ self.earth_dps).T, (3, len(at_s)))
        return by_earth if self.at_rest(at_s) else by_earth + np.degrees(self._turning(at_s)[0]).T

    def _turning(self, at_s: Array) -> tuple[Array, Array]:
        rates = [axis.true_rates(at_s) for axis in self._axes]
        angles_deg = [axis.true_deg(at_s) for axis in self._axes]
        return self._fixture.turning(angles_deg, [rate for rate, _ in rates], [change for _, change in rates])

    def sweeps(self, still_deg: Stands) -> bool:
        """Return whether only one axis turns, and only its angle changes."""
        return still_deg.count(None) == 1 and not self._table.wobble_deg

    def sweep(self, still_deg: Stands, at_s: float) -> Array:
        """Attitude while one axis turns alone: coefficients of `waves_of` its angle, (3, 3, 3)."""
        if still_deg != self._sweep[0]:
            quarters_deg = np.array([0.0, 90.0, 180.0])
            angles_deg = [quarters_deg if at is None else np.full(3, at) for at in still_deg]
            ahead, aside, back = self._turned(angles_deg, at_s)
            middle = (ahead + back) / 2
            self._sweep = still_deg, np.stack([middle, ahead - middle, aside - middle])
        return self._sweep[1]

    def _turned(self, angles_deg: list[Array], at_s: float) -> Array:
        """Level frame to fixture, with the tilts of the base and of the outer axis."""
        table, level_deg = self._table, np.array([self._level.at(at_s)])
        if table.wobble_deg:
            level_deg = level_deg + table.wobble_deg * np.cos(np.radians(angles_deg[0]) + table.wobble_phase_rad)
        turned = self._fixture.to_fixture(angles_deg, level_deg)
        return turned @ turn(EAST, np.array([-table.across_deg])) if table.across_deg else turned


def waves_of(angle_deg: Array) -> Array:
    """A constant, the cosine and the sine of angles (n,), (3, n): basis of every quantity that turns with an axis."""
    angle = np.radians(angle_deg)
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
