"""An indexing head without a motor, and the operator who turns it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from drivers.certificates.corrections import TURN_DEG
from drivers.person import Turn
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan
from simulators.world import World


class HandTurnedHead:
    """A head of the world, that of a `role` where there are several; it stays at the angle set by hand.

    `silent`: no operator. `stuck`: it does not turn, and the operator does not notice.
    """

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {"stuck": PASSIVE_FAULT}

    def __init__(self, world: World, faults: FaultPlan, role: str | None = None) -> None:
        self.faults = faults
        self._world, self._role = world, role

    @property
    def attended(self) -> bool:
        """True if an operator is present."""
        return not self.faults.active("silent")

    @property
    def shown_deg(self) -> float:
        """Angle shown by its dial (°)."""
        return self._world.axis_of(self._role).encoder_deg(self._world.now())

    def turn(self, turn: Turn) -> None:
        """Turn it by hand to an angle."""
        if self.faults.active("stuck"):
            return
        from_above = turn.approach == "from_above"
        if turn.approach == "direct":
            from_above = turn.angle_deg < self.shown_deg
        self._world.place(turn.angle_deg, from_above=from_above, role=self._role)

    def turn_to_dial(self, typed_deg: float, asked: Turn) -> None:
        """Turn it by hand to an angle on its dial, which covers one turn, instead of the requested one."""
        angle_deg = asked.angle_deg + math.remainder(typed_deg - asked.angle_deg, TURN_DEG)
        self.turn(Turn(angle_deg, asked.approach))
