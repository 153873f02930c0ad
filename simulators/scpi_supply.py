"""A laboratory power supply: level, current limit and output, and the units on it that draw current."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

from drivers.scpi_supply import wire
from simulators.faults import MEASURES_AND_OBEYS, FaultKind, FaultPlan, Mishap
from simulators.scpi import NOT_ALLOWED, SETTINGS_CONFLICT, Interpreter, LineSession, Refusal, setting, switch
from simulators.setup import InstrumentSetup
from simulators.world import World

VOLTAGE_MAX_V = 32.0
CURRENT_MAX_A = 3.0


class SimulatedSupply:
    """One output, at the units whose place names it.

    `frozen`: measured values repeat. `stuck`: the output does not switch, whatever it is told.
    """

    def __init__(
        self,
        world: World,
        faults: FaultPlan,
        *,
        name: str = "supply",
        model: str = "SIM-PSU",
        serial: str = "SIM-PSU-01",
    ) -> None:
        self.faults = faults
        self._world, self._name = world, name
        self._level_v, self._limit_a, self.output = 0.0, CURRENT_MAX_A, False
        self._measured, self._tripped = (0.0, 0.0), set[str]()
        self._interpreter = Interpreter(
            f"INERTIAL TEST BENCH,{model},{serial},1.0",
            {
                wire.VOLTAGE: self._set_level,
                f"{wire.VOLTAGE}?": lambda asked: f"{_asked(asked, self._level_v, VOLTAGE_MAX_V):.3f}",
                wire.CURRENT: self._set_limit,
                f"{wire.CURRENT}?": lambda asked: f"{_asked(asked, self._limit_a, CURRENT_MAX_A):.4f}",
                wire.OUTPUT: self._switch,
                f"{wire.OUTPUT}?": lambda _: str(int(self.output)),
                f"{wire.MEASURE_VOLTAGE}?": lambda _: f"{self._measure()[0]:.4f}",
                f"{wire.MEASURE_CURRENT}?": lambda _: f"{self._measure()[1]:.5f}",
                f"{wire.OVER_VOLTAGE}?": lambda _: str(int("over_voltage" in self._tripped)),
                f"{wire.OVER_CURRENT}?": lambda _: str(int("over_current" in self._tripped)),
                "APPLy": self._apply,
                "APPLy?": lambda _: f'"{self._level_v:.3f},{self._limit_a:.4f}"',
                **dict.fromkeys(("SYSTem:REMote", "SYSTem:LOCal", "SYSTem:RWLock"), lambda _: None),
                "*RST": lambda _: self._reset(),
            },
        )

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """As a bench file has it."""
        model, serial = setup.model or "SIM-PSU", setup.serial or "SIM-PSU-01"
        return cls(setup.world, setup.faults, name=setup.role, model=model, serial=serial)

    def session(self) -> LineSession:
        """A new connection."""
        return LineSession(self._interpreter.execute)

    def trip(self, protection: str = "") -> None:
        """The output goes off by itself; where a `protection` did it, it stays off until somebody clears that."""
        self.output = False
        if protection:
            self._tripped.add(protection)
        self._feed_units()

    def restart(self) -> None:
        """The mains fail for a moment: everything is as when it was switched on."""
        self._reset()
        self._interpreter.power_on()

    def _set_level(self, argument: str) -> None:
        self._level_v = round(setting(argument, 0.0, VOLTAGE_MAX_V), 3)
        self._feed_units()

    def _set_limit(self, argument: str) -> None:
        self._limit_a = round(setting(argument, 0.0, CURRENT_MAX_A), 4)

    def _apply(self, argument: str) -> None:
        level, _, limit = (part.strip() for part in argument.partition(","))
        self._set_limit(limit or str(self._limit_a))
        self._set_level(level)

    def _switch(self, argument: str) -> None:
        on = switch(argument)
        if on and self._tripped:
            raise Refusal(SETTINGS_CONFLICT)
        if not self.faults.active("stuck"):
            self.output = on
            self._feed_units()

    def _feed_units(self) -> None:
        self._world.power(self._name, self.output and self._level_v > 0)

    def _measure(self) -> tuple[float, float]:
        """Voltage and current at the terminals; a load above the limit pulls the voltage down."""
        if not self.faults.active("frozen"):
            load_a = self._world.load_a(self._name) if self.output and self._level_v > 0 else 0.0
            current_a = min(load_a, self._limit_a)
            voltage_v = self._level_v * (current_a / load_a if load_a else 1.0) if self.output else 0.0
            self._measured = (voltage_v, current_a)
        return self._measured

    def _reset(self) -> None:
        self._tripped.clear()
        self._level_v, self._limit_a, self.output = 0.0, CURRENT_MAX_A, False
        self._feed_units()

    MISHAPS: ClassVar[Mapping[FaultKind, Mishap]] = {
        **MEASURES_AND_OBEYS,
        "tripped": Mishap(trip),
        "restart": Mishap(restart),
    }


def _asked(which: str, set_to: float, most: float) -> float:
    """What a question for a level is answered: what it is set to, or with MIN or MAX what it can be."""
    if which.upper() not in ("", "MIN", "MAX"):
        raise Refusal(NOT_ALLOWED)
    return {"MIN": 0.0, "MAX": most}.get(which.upper(), set_to)
