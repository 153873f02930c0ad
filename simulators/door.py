"""The door of a chamber: it acts on the air, whatever the controller knows of it."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.faults import MEASURES_AND_OBEYS, FaultKind, Mishap
from simulators.world import World


class HasDoor:
    """A chamber in the world; a controller with a contact at the door adds what it makes of it."""

    _world: World

    def open_door(self) -> None:
        """Somebody opens the door."""
        self._world.door(is_open=True)

    def close_door(self) -> None:
        """Somebody closes it again."""
        self._world.door(is_open=False)


CHAMBER_MISHAPS: Mapping[FaultKind, Mishap] = {
    **MEASURES_AND_OBEYS,
    "door_open": Mishap(lambda chamber: chamber.open_door(), lambda chamber: chamber.close_door()),
}
"""What can happen to every chamber."""
