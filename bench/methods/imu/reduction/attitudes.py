"""The 24 attitudes in which the axes of a cube are along east, north and up (equations 4.2).

Attitude Ax1 to Ax4 have the x axis up, Ax5 to Ax8 down, each at four headings; Ay and Az likewise. At rest an axis that
points up reads +1 g. The frame is east, north, up; a letter W, S or D is the opposite of E, N or U.
"""

from __future__ import annotations

import numpy as np

from bench.metrology.attitude_names import ATTITUDES
from bench.metrology.least_squares import Array

HEADINGS = 4  # of an axis that points up, and of one that points down
BLOCK = 2 * HEADINGS  # attitudes of one axis
NAMES = tuple(ATTITUDES)

_EAST, _NORTH, _UP = np.eye(3)
_DIRECTIONS = {"E": _EAST, "W": -_EAST, "N": _NORTH, "S": -_NORTH, "U": _UP, "D": -_UP}

BODY_AXES = np.array([[_DIRECTIONS[letter] for letter in letters] for letters in ATTITUDES.values()])
"""Rotation matrices of the attitudes, rows x, y and z in east, north and up: (24, 3, 3), from local to body vectors."""

SPECIFIC_FORCE_G = BODY_AXES @ _UP
"""Readings of ideal accelerometers x, y and z at rest, in local g: (24, 3)."""

NORTH = BODY_AXES @ _NORTH
"""North component of each body axis: (24, 3)."""

EARTH_RATE_DPS = float(np.degrees(7.292115e-5))


def earth_rate_dps(latitude_deg: float) -> Array:
    """Readings of ideal gyros x, y and z at rest, in °/s: (24, 3)."""
    return np.asarray(BODY_AXES @ local_earth_rate_dps(latitude_deg))


def local_earth_rate_dps(latitude_deg: float) -> Array:
    """Earth rate in east, north and up, in °/s; northern latitudes are positive."""
    latitude = np.radians(latitude_deg)
    return np.asarray(EARTH_RATE_DPS * (np.cos(latitude) * _NORTH + np.sin(latitude) * _UP))


def block(axis: int) -> slice:
    """The eight attitudes in which `axis` (0, 1, 2) is vertical: first up, then down."""
    return slice(axis * BLOCK, (axis + 1) * BLOCK)
