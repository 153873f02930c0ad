"""The simulated chamber: its messages, connected to the air of the world.

The off state is not simulated: a new set point is stored until the chamber is switched on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Self

from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.scpi import ILLEGAL_VALUE, Interpreter, LineSession, Refusal, setting
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

from toy_chamber import wire
from toy_chamber.wire import Mode

LIMITS_C = (-40.0, 120.0)
AFTER_RESTART_C, PROGRAM_C = 25.0, 60.0
PROGRAM_C_PER_S = 1 / 60


class SimulatedToyChamber(SimulatedChamber):
    """One controller. `stuck`: settings are accepted and not executed. `frozen`: the air reading does not change."""

    def __init__(self, world: World, faults: FaultPlan, *, serial: str = "0001") -> None:
        super().__init__(world, faults)
        self.mode = Mode.ON
        self.set_point_c = wire.as_stored(world.thermal.set_point_c)
        self._interpreter = Interpreter(
            f"MAKER,TC-100,{serial},1.0",
            {
                f"{wire.TEMPERATURE}?": lambda _: f"{self._read_c():.2f}",
                f"{wire.SET_POINT}?": lambda _: f"{self.set_point_c:.1f}",
                wire.SET_POINT: self._set,
                f"{wire.MODE}?": lambda _: self.mode.value,
                wire.MODE: self._enter,
                f"{wire.LIMITS}?": lambda _: ",".join(f"{limit_c:.1f}" for limit_c in LIMITS_C),
            },
        )

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(setup.world, setup.faults, serial=setup.serial or "0001")

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self._interpreter.execute)

    def start_program(self) -> None:
        """Start a program at the front panel."""
        self.mode = Mode.PROGRAM
        self._world.ramp(PROGRAM_C, PROGRAM_C_PER_S)

    def switch_off(self) -> None:
        """Switch the chamber off at the front panel."""
        self.mode = Mode.OFF

    def switch_on(self) -> None:
        """Switch the chamber on at the front panel."""
        self.mode = Mode.ON
        self._follow()

    def restart(self) -> None:
        """Short power failure: it restarts with its own set point."""
        self.set_point_c = AFTER_RESTART_C
        self._interpreter.power_on()
        self.switch_on()

    def _set(self, argument: str) -> None:
        set_point_c = wire.as_stored(setting(argument, *LIMITS_C))
        if not self.faults.active("stuck"):
            self.set_point_c = set_point_c
            self._follow()

    def _enter(self, argument: str) -> None:
        if argument not in (Mode.ON.value, Mode.OFF.value):
            raise Refusal(ILLEGAL_VALUE)
        if not self.faults.active("stuck"):
            self.mode = Mode(argument)
            self._follow()

    def _follow(self) -> None:
        if self.mode is Mode.ON:
            self._world.ramp(self.set_point_c, math.inf)

    def _read_c(self) -> float:
        self._world.look()
        return self.measured_c()

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": FaultEffect(restart),
        "program": FaultEffect(start_program, switch_on),
        "front_panel": FaultEffect(switch_off, switch_on),
    }
