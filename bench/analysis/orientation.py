"""How a unit lies during an acquisition, as far as the bench knows: nominal angles, mounts and level (methods.md 8.1).

The level frame is east, north, up. In the frame of a unit x is the input axis, y the output axis, z the pendulous axis;
at rest an axis that points up reads +1 g.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from bench.analysis.rundata import Acquisition, Array, BenchRecord, UnitUnderTest

SOUTH = np.array([0.0, -1.0, 0.0])
IN_PLANE = 1e-6  # of g along the output axis of a unit that is turned in the plane of its input axis


def unit_axes(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> Array:
    """The axes of a unit in the level frame, a row each: (3, 3), which turns a level vector into the unit's frame."""
    turned = Rotation.from_rotvec(math.radians(bench.level_deg) * SOUTH)
    for role, axis in bench.axes.items():
        turned *= Rotation.from_rotvec(math.radians(acquisition.angles_deg.get(role, 0.0)) * np.array(axis.points))
    x, z = np.array(bench.x), np.array(bench.z)
    fixture = np.stack([x, np.cross(z, x), z])
    return np.asarray(_into_unit(acquisition, unit) @ fixture @ turned.as_matrix().T)


def specific_force_g(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> Array:
    """What gravity is along the input, the output and the pendulous axis of a unit at rest, (3,)."""
    return unit_axes(acquisition, unit, bench)[:, 2]


def elevation_rad(acquisition: Acquisition, unit: UnitUnderTest, bench: BenchRecord) -> float:
    """The angle of the input axis above the horizontal, the pendulous axis being at a right angle to it, up to ±π.

    The output axis is level; ValueError when it is not.
    """
    along, across, pendulous = specific_force_g(acquisition, unit, bench).tolist()
    if abs(across) > IN_PLANE:
        raise ValueError(f"the output axis is not level: {across:.3g} g along it")
    return math.atan2(along, pendulous)


def _into_unit(acquisition: Acquisition, unit: UnitUnderTest) -> Array:
    """Fixture to unit: raised by the mount, rolled, clocked, raised by the angle of the place."""
    mount = acquisition.mount
    steps = [("y", mount.angle_deg), ("x", mount.roll_deg), ("z", mount.clock_deg), ("y", unit.mount_angle_deg)]
    turned = Rotation.identity()
    for axis, angle_deg in steps:
        turned *= Rotation.from_euler(axis, -angle_deg if axis == "y" else angle_deg, degrees=True)
    return np.asarray(turned.as_matrix().T)
