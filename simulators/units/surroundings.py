"""The world as seen by a simulated unit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.physics.attitude import Fixture, Mount
from simulators.physics.motion import Axis
from simulators.physics.table_kinematics import TableKinematics
from simulators.physics.thermal import Thermal
from simulators.units.settings import WorldSettings

Array = NDArray[np.float64]


class Surroundings(Protocol):
    """The laboratory around a unit: true time, temperatures, attitude and motion, the current fed into a converter."""

    settings: WorldSettings
    mount: Mount
    fixture: Fixture
    axes: dict[str, Axis]
    kinematics: TableKinematics
    thermal: Thermal

    def now(self) -> float:
        """True seconds since the start of the world."""

    def moves_until_s(self, from_s: float, now_s: float) -> float:
        """Return when all axes that move at `from_s` are at rest; `now_s` if one goes on moving."""

    def integrate_with(self, catch_up: Callable[[], None]) -> None:
        """Register a function that is called before a stimulus changes."""

    def source_a(self, source: str, at_s: Array) -> Array:
        """Return the current out of a source's cable at true times, in A."""
