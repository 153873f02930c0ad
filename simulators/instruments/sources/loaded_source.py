"""Common part of simulated SCPI current sources: an output with a load resistor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simulators.faults.instrument_faults import COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.scpi import ScpiInstrument
from simulators.world import World

WITHOUT_WIRE = 1e6  # factor of its load


class LoadedSource(ScpiInstrument):
    """An output in front of `load_ohm`. `stuck`: settings are accepted and not executed."""

    def __init__(self, world: World, faults: FaultPlan, load_ohm: float) -> None:
        self.faults = faults
        self.load_ohm = load_ohm
        self.level_a, self.compliance_v, self.output = 0.0, 0.0, False
        self._world = world

    @property
    def current_a(self) -> float:
        """True output current: the level, or the current driven through the load by the compliance."""
        if not self.output:
            return 0.0
        most_a = self.compliance_v / self.load_ohm
        return max(-most_a, min(self.level_a, most_a))

    @property
    def feeds_a(self) -> float | None:
        """Current out of its terminals; None while the output is off."""
        return self.current_a if self.output else None

    def take_load_off(self) -> None:
        """Disconnect the load: almost no current flows."""
        self._world.before_change()
        self.load_ohm *= WITHOUT_WIRE

    def put_load_back(self) -> None:
        """Reconnect the load."""
        self._world.before_change()
        self.load_ohm /= WITHOUT_WIRE

    def put_output(self, on: bool) -> None:
        """Switch the output."""
        self._world.before_change()
        self.output = on

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **COMMAND_FAULTS,
        "compliance": FaultEffect(take_load_off, put_load_back),
        "restart": FaultEffect(ScpiInstrument.restart),
    }
