"""The simulated thermometer: its sensor is in the air of the chamber."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.scpi import Interpreter, LineSession
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

from toy_thermometer import wire


class SimulatedToyThermometer:
    """One thermometer. `frozen`: the reading does not change."""

    def __init__(self, world: World, faults: FaultPlan, *, serial: str = "0001") -> None:
        self.faults = faults
        self.is_open = False
        self._world = world
        self._read_c = world.thermal.air_c
        self._interpreter = Interpreter(
            f"MAKER,TH-100,{serial},1.0", {f"{wire.TEMPERATURE}?": lambda _: wire.spelled(self._temperature_c())}
        )

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(setup.world, setup.faults, serial=setup.serial or "0001")

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self._interpreter.execute)

    def open_sensor(self) -> None:
        """Open the sensor circuit."""
        self.is_open = True

    def close_sensor(self) -> None:
        """Close the sensor circuit."""
        self.is_open = False

    def _temperature_c(self) -> float | None:
        self._world.look()
        if not self.faults.active("frozen"):
            self._read_c = self._world.thermal.air_c
        return None if self.is_open else self._read_c

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        "frozen": PASSIVE_FAULT,
        "open_sensor": FaultEffect(open_sensor, close_sensor),
    }
