"""What simulated SCPI current sources have in common: an output with a resistor on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simulators.faults.instrument_faults import OBEYS, FaultKind, FaultPlan, Mishap
from simulators.instruments.scpi import Handler, Refusal
from simulators.world import World

WITHOUT_WIRE = 1e6  # times its load


class LoadedSource:
    """An output in front of `load_ohm`. `stuck`: settings are accepted and not carried out."""

    def __init__(self, world: World, faults: FaultPlan, load_ohm: float) -> None:
        self.faults = faults
        self.load_ohm = load_ohm
        self.level_a, self.compliance_v, self.output = 0.0, 0.0, False
        self._world = world

    @property
    def current_a(self) -> float:
        """What really flows: the level, or what the compliance drives through the load."""
        if not self.output:
            return 0.0
        most_a = self.compliance_v / self.load_ohm
        return max(-most_a, min(self.level_a, most_a))

    @property
    def feeds_a(self) -> float | None:
        """What flows out of its terminals; None while its output is off."""
        return self.current_a if self.output else None

    def take_load_off(self) -> None:
        """Disconnect the load: almost no current flows."""
        self._world.before_change()
        self.load_ohm *= WITHOUT_WIRE

    def put_load_back(self) -> None:
        """It is connected again."""
        self._world.before_change()
        self.load_ohm /= WITHOUT_WIRE

    def put_output(self, on: bool) -> None:
        """Switches the output."""
        self._world.before_change()
        self.output = on

    def unless_stuck(self, handler: Handler) -> Handler:
        """What carries a setting out, or does not, or not yet."""
        return lambda argument: self.faults.carry_out(lambda: handler(argument), Refusal)

    MISHAPS: ClassVar[Mapping[FaultKind, Mishap]] = {
        **OBEYS,
        "compliance": Mishap(take_load_off, put_load_back),
    }
