"""Common part of simulated chambers: door, heater, cooling and air sensor, with their faults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from simulators.faults.instrument_faults import (
    MEASUREMENT_AND_COMMAND_FAULTS,
    OPEN_C,
    PASSIVE_FAULT,
    FaultEffect,
    FaultKind,
    FaultPlan,
)
from simulators.physics.chamber_failures import Failure
from simulators.world import World


class SimulatedChamber:
    """A chamber of the world with a controller of some make, which reads its air by `measured_c`.

    A controller with a door contact adds its reaction.

    `frozen`: the air reading does not change. `open_sensor`: it is that of an open sensor. `detached_sensor`: it is the
    room temperature.
    """

    faults: FaultPlan
    _air_c: float  # last reading, repeated while frozen

    def __init__(self, world: World, faults: FaultPlan) -> None:
        self._world, self.faults = world, faults
        self._air_c = world.thermal.air_c

    def measured_c(self) -> float:
        """Reading of the controller's sensor, with the world advanced to now."""
        if self.faults.active("open_sensor"):
            return OPEN_C
        if self.faults.active("detached_sensor"):
            return self._world.settings.ambient_c
        if not self.faults.active("frozen"):
            self._air_c = self._world.thermal.air_c
        return self._air_c

    def move_door(self, *, is_open: bool) -> None:
        """Open or close the door."""
        self._world.door(is_open=is_open)

    def break_down(self, failure: Failure | None) -> None:
        """Break a part of the chamber, independent of its controller; None repairs it."""
        self._world.chamber_fails(failure)


def _breaks(failure: Failure) -> FaultEffect:
    return FaultEffect(lambda chamber: chamber.break_down(failure), lambda chamber: chamber.break_down(None))


CHAMBER_FAULT_EFFECTS: Mapping[FaultKind, FaultEffect] = {
    **MEASUREMENT_AND_COMMAND_FAULTS,
    "door_open": FaultEffect(
        lambda chamber: chamber.move_door(is_open=True), lambda chamber: chamber.move_door(is_open=False)
    ),
    "open_sensor": PASSIVE_FAULT,
    **{failure: _breaks(failure) for failure in get_args(Failure)},
}
"""Faults of every chamber."""
