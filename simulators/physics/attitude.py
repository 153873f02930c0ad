"""Attitude of a unit: from the axes of the table, the fixture and the mount to directions in the unit (equations 8.1).

Frames: level (east, north, up); fixture, whose x, y, z turn with the table; unit, where x is the input axis, y the
output axis and z the pendulous axis. A rotation is a matrix (n, 3, 3) that transforms components in one frame into
those in the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

EAST, NORTH, UP = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SOUTH: Vector = (0.0, -1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Fixture:
    """Axes of the table and of its fixture at zero angles.

    `axes` are the directions of the positive axes of the table, outer first; `x` and `z` those of the fixture.
    """

    axes: tuple[Vector, ...] = (SOUTH,)
    x: Vector = EAST
    z: Vector = UP

    def to_fixture(self, angles_deg: Sequence[Array], level_deg: Array | float = 0.0) -> Array:
        """Level frame to fixture, (n, 3, 3), for the angles (n,) of each axis.

        `level_deg` is the tilt of the base about south, one value or (n,).
        """
        turned = turn(SOUTH, np.atleast_1d(np.asarray(level_deg, np.float64)))
        for axis, angle_deg in zip(self.axes, angles_deg, strict=True):
            turned = turned @ turn(axis, angle_deg)
        return np.asarray(_body(self.x, self.z) @ turned.transpose(0, 2, 1))

    def rate(self, angles_deg: Sequence[Array], rates_dps: Sequence[Array]) -> Array:
        """Angular rate of the fixture relative to the level frame, in the fixture's frame, °/s, (n, 3)."""
        total = np.zeros((len(angles_deg[0]), 3))
        turned = np.broadcast_to(np.eye(3), (len(total), 3, 3))
        for axis, angle_deg, rate_dps in zip(self.axes, angles_deg, rates_dps, strict=True):
            total += (turned @ np.array(axis)) * rate_dps[:, np.newaxis]
            turned = turned @ turn(axis, angle_deg)
        return np.asarray(np.einsum("ij,nkj,nk->ni", _body(self.x, self.z), turned, total))

    def turning(
        self, angles_deg: Sequence[Array], rates_dps: Sequence[Array], changes_dps2: Sequence[Array]
    ) -> tuple[Array, Array]:
        """Angular velocity of the fixture in rad/s and its derivative in rad/s², in the fixture's frame, (n, 3).

        An inner axis changes its direction while the outer ones turn.
        """
        velocity = np.zeros((len(angles_deg[0]), 3))
        change, turned = np.zeros_like(velocity), np.broadcast_to(np.eye(3), (len(velocity), 3, 3))
        for axis, angle_deg, rate_dps, change_dps2 in zip(self.axes, angles_deg, rates_dps, changes_dps2, strict=True):
            along = turned @ np.array(axis)
            own = along * np.radians(rate_dps)[:, np.newaxis]
            change = change + along * np.radians(change_dps2)[:, np.newaxis] + np.cross(velocity, own)
            velocity = velocity + own
            turned = turned @ turn(axis, angle_deg)
        to_fixture = _body(self.x, self.z) @ turned.transpose(0, 2, 1)
        return (to_fixture @ velocity[..., np.newaxis])[..., 0], (to_fixture @ change[..., np.newaxis])[..., 0]


@lru_cache(maxsize=64)
def _body(x: Vector, z: Vector) -> Array:
    """Rows are the axes of a fixture in the level frame while all angles are 0."""
    return np.array([x, np.cross(z, x), z])


def tilted(fixture: Fixture, base_deg: Vector, apart_deg: Sequence[tuple[float, float]]) -> Fixture:
    """The table as installed: rotated by small angles about east, north and up.

    `apart_deg` are the non-orthogonalities of each axis after the first to its outer axis, about the two directions of
    `square_to`.
    """
    outer, *inner = (np.array(axis) for axis in fixture.axes)
    moved = [outer]
    for axis, angles_deg in zip(inner, apart_deg, strict=True):
        small = sum(angle * across for angle, across in zip(np.radians(angles_deg), square_to(axis), strict=True))
        moved.append(axis + np.cross(small, axis))
    x, z = np.array(fixture.x), np.array(fixture.z)
    base = np.linalg.multi_dot([_small(axis, angle) for axis, angle in zip((EAST, NORTH, UP), base_deg, strict=True)])
    return Fixture(tuple(_unit(base @ axis) for axis in moved), _unit(base @ x), _unit(base @ z))


def square_to(axis: Array) -> tuple[Array, Array]:
    """Two directions perpendicular to a unit vector and to each other, in a right-handed set."""
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
    return np.cross(first, axis), first


def _small(axis: Vector, angle_deg: float) -> Array:
    return np.asarray(turn(axis, np.array([angle_deg]))[0])


def _unit(vector: Array) -> Vector:
    return _vector(vector / np.linalg.norm(vector))


@dataclass(frozen=True, slots=True)
class Mount:
    """Mounting angles of units, in degrees.

    Rotation about the output axis by `angle_deg`, then about the input axis (roll), then about the pendulous axis
    (clock).
    """

    angle_deg: float = 0.0
    roll_deg: float = 0.0
    clock_deg: float = 0.0


@lru_cache(maxsize=64)
def to_unit(mount: Mount, own_deg: float, own_clock_deg: float = 0.0) -> Array:
    """Fixture to unit, (3, 3); in its place the unit is raised by `own_deg` in addition, then clocked."""
    return (
        _clocked(own_clock_deg)
        @ raised(own_deg)
        @ _clocked(mount.clock_deg)
        @ _rolled(mount.roll_deg)
        @ raised(mount.angle_deg)
    )


def turn(axis: Vector, angle_deg: Array) -> Array:
    """Rotation matrices about a unit vector by angles (n,), (n, 3, 3), by Rodrigues' formula."""
    turned, one = np.radians(angle_deg), np.newaxis
    along, across, cross = _rodrigues(axis)
    return np.asarray(along + np.cos(turned)[:, one, one] * across + np.sin(turned)[:, one, one] * cross)


@lru_cache(maxsize=64)
def _rodrigues(axis: Vector) -> tuple[Array, Array, Array]:
    """Parts of a rotation about a unit vector: the constant one, and those in proportion to cosine and sine."""
    x, y, z = axis
    along = np.outer(axis, axis)
    return along, np.eye(3) - along, np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def raised(angle_deg: float) -> Array:
    """Rotation into a frame whose x is raised towards z."""
    sine, cosine = _sine_and_cosine(angle_deg)
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


def _rolled(angle_deg: float) -> Array:
    sine, cosine = _sine_and_cosine(angle_deg)
    return np.array([[1, 0, 0], [0, cosine, sine], [0, -sine, cosine]])


def _clocked(angle_deg: float) -> Array:
    sine, cosine = _sine_and_cosine(angle_deg)
    return np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def _sine_and_cosine(angle_deg: float) -> tuple[float, float]:
    return math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return (x, y, z)
