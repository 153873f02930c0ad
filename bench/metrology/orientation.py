"""Orientation of a unit during an acquisition: nominal angles, mounts and level (equations 8.1).

The level frame is east, north, up. In the frame of a unit x is the input axis, y the output axis, z the pendulous axis;
at rest an axis that points up reads +1 g.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bench.metrology.acquisition import Acquisition, Array, Mount
from bench.metrology.bench_uncertainty import BenchRecord, Vector

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.metrology.run_data import UnitUnderTest

SOUTH = np.array([0.0, -1.0, 0.0])
ELSEWHERE_DEG = 37.0  # from no position of a tumble to another
IN_PLANE = 1e-6  # g along the output axis; a unit rotated in the plane of its input axis has none


def unit_axes(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> Array:
    """Axes of a unit in the level frame, a row each: (3, 3), which rotates a level vector into the unit's frame."""
    turns = [(axis.points, acquisition.angles_deg.get(role, 0.0)) for role, axis in bench.axes.items()]
    own_deg = unit.mount_angle_deg, unit.clock_deg
    return turned_axes(turns, bench.x, bench.z, acquisition.mount, own_deg, bench.level_deg)


def turned_axes(
    turns: Iterable[tuple[Vector, float]], x: Vector, z: Vector, mount: Mount, own_deg: tuple[float, float],
    level_deg: float = 0.0,
) -> Array:  # fmt: skip
    """The same for any table: `turns` are directions and angles (°) of its axes, outer first.

    `x` and `z` are directions of the fixture with all angles at 0; the unit is raised in it, and clocked, by `own_deg`.
    """
    return _turned_axes(tuple(turns), x, z, mount, own_deg, level_deg).copy()


@lru_cache(maxsize=512)  # a table returns to the same angles again and again
def _turned_axes(
    turns: tuple[tuple[Vector, float], ...], x: Vector, z: Vector, mount: Mount, own_deg: tuple[float, float],
    level_deg: float,
) -> Array:  # fmt: skip
    turned = rotation(SOUTH, math.radians(level_deg))
    for points, angle_deg in turns:
        turned = turned @ rotation(points, math.radians(angle_deg))
    return np.asarray(_unit_at_zero(x, z, mount, own_deg) @ turned.T)


def rotation(axis: Vector | Array, angle_rad: float) -> Array:
    """Matrix (3, 3) that rotates a vector about a unit vector by an angle.

    Rodrigues' formula: https://mathworld.wolfram.com/RodriguesRotationFormula.html.
    """
    cross = cross_matrix(axis)  # scipy.spatial imports many modules, which no run and few reports need otherwise
    return np.asarray(np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * (cross @ cross))


def cross_matrix(vector: Vector | Array) -> Array:
    """Matrix (3, 3) of the product vector × r for any r."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def specific_force_g(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> Array:
    """Gravity along the input, the output and the pendulous axis of a unit at rest, (3,) in g."""
    return unit_axes(acquisition, unit, bench)[:, 2]


def elevation_rad(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> float:
    """Angle of the input axis above the horizontal, the pendulous axis being at a right angle to it, up to ±π.

    The output axis is level, or of a clocked unit the pendulous axis, with the output axis in its place; ValueError
    when neither is.
    """
    along, across, pendulous = specific_force_g(acquisition, unit, bench).tolist()
    if abs(across) <= IN_PLANE:
        return math.atan2(along, pendulous)
    if abs(pendulous) <= IN_PLANE:
        return math.atan2(along, across)
    raise ValueError(f"the output axis is not level: {across:.3g} g along it; nor is the pendulous axis")


def is_clocked(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> bool:
    """True for a unit rotated by 90° about its input axis: its pendulous axis, not the output axis, stays level.

    With the input axis vertical both are level at any rotation; the table is thought to be turned on.
    """
    here = specific_force_g(acquisition, unit, bench)
    role = next(iter(bench.axes), "")
    turned = replace(acquisition, angles_deg={**acquisition.angles_deg, role: acquisition.angle_deg + ELSEWHERE_DEG})
    there = specific_force_g(turned, unit, bench)
    return bool(max(abs(here[2]), abs(there[2])) <= IN_PLANE < max(abs(here[1]), abs(there[1])))


@lru_cache(maxsize=64)  # few mounts occur
def _unit_at_zero(x: Vector, z: Vector, mount: Mount, own_deg: tuple[float, float]) -> Array:
    """Axes of a unit in a level fixture at angles of 0: raised by the mount, rolled, clocked, then raised, clocked."""
    raised_deg, clocked_deg = own_deg
    along_x, against_y, along_z = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)
    turned = np.eye(3)
    for axis, angle_deg in (
        (against_y, mount.angle_deg), (along_x, mount.roll_deg), (along_z, mount.clock_deg),
        (against_y, raised_deg), (along_z, clocked_deg),
    ):  # fmt: skip
        turned = turned @ rotation(axis, math.radians(angle_deg))
    return np.asarray(turned.T @ np.stack([x, np.cross(z, x), z]))


def by_harmonics(turned: Array, head_rad: Array, u_deg: Sequence[float]) -> Array:
    """Signed contributions of the harmonics of a head to a result, (2m,), cosine and sine of each in turn.

    `turned` (n,) is the change of the result for 1 rad of the head at each of its angles.
    """
    return np.array(
        [
            float(turned @ shape(order * head_rad)) * np.radians(u)
            for order, u in enumerate(u_deg, start=1)
            for shape in (np.cos, np.sin)
        ]
    )
