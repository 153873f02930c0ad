"""A laboratory power supply: level, current limit and output, and the units that load it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Self

from drivers.dialects.scpi_supply import wire
from simulators.faults.instrument_faults import MEASUREMENT_AND_COMMAND_FAULTS, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.scpi import (
    ILLEGAL_VALUE,
    SETTINGS_CONFLICT,
    Handler,
    Interpreter,
    LineSession,
    Refusal,
    ScpiInstrument,
    asked,
    setting,
    switch,
)
from simulators.instruments.setup import InstrumentSetup
from simulators.instruments.stored_settings import StoredSettings, stored_number, stored_switch
from simulators.world import World

VOLTAGE_MAX_V = 32.0
WATCHDOG_S, WATCHDOG_MAX_S = 60.0, 3600.0  # default at delivery
CURRENT_MAX_A = 3.0
_CLEARS = ("OUTPut:PROTection:CLEar", "[SOURce:]VOLTage:PROTection:CLEar", "[SOURce:]CURRent:PROTection:CLEar")
_NOTHING_HAPPENS = (
    "SYSTem:REMote", "SYSTem:LOCal", "SYSTem:RWLock", "SYSTem:BEEPer[:IMMediate]", "DISPlay[:STATe]",
    "DISPlay:TEXT[:DATA]", "DISPlay:TEXT:CLEar",
)  # fmt: skip
_STORED = {  # levels at which others trip; here it trips on request
    "[SOURce:]VOLTage:PROTection[:LEVel]": stored_number(35.2, 0.0, 35.2, lambda value: f"{value:.3f}"),
    "[SOURce:]VOLTage:PROTection:STATe": stored_switch("1"),
    "[SOURce:]CURRent:PROTection[:LEVel]": stored_number(3.3, 0.0, 3.3, lambda value: f"{value:.4f}"),
    "[SOURce:]CURRent:PROTection:STATe": stored_switch("0"),
}


class SimulatedSupply(ScpiInstrument):
    """One output, with the units whose places name it.

    `frozen`: measured values repeat. `stuck`: the output does not switch.
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
        self._stored = StoredSettings(_STORED)
        self._watchdog, self._watchdog_s, self._last_message_s = False, WATCHDOG_S, 0.0
        self._interpreter = Interpreter(
            f"INERTIAL TEST BENCH,{model},{serial},1.0",
            {
                wire.VOLTAGE: self._maybe_delayed(self._set_level),
                f"{wire.VOLTAGE}?": lambda which: f"{asked(which, self._level_v, 0.0, VOLTAGE_MAX_V):.3f}",
                wire.CURRENT: self._maybe_delayed(self._set_limit),
                f"{wire.CURRENT}?": lambda which: f"{asked(which, self._limit_a, 0.0, CURRENT_MAX_A):.4f}",
                wire.OUTPUT: self._switch,
                f"{wire.OUTPUT}?": lambda _: str(int(self.output)),
                f"{wire.MEASURE_VOLTAGE}?": lambda _: f"{self._measure()[0]:.4f}",
                f"{wire.MEASURE_CURRENT}?": lambda _: f"{self._measure()[1]:.5f}",
                f"{wire.OVER_VOLTAGE}?": lambda _: str(int("over_voltage" in self._tripped)),
                f"{wire.OVER_CURRENT}?": lambda _: str(int("over_current" in self._tripped)),
                wire.WATCHDOG: self._arm,
                f"{wire.WATCHDOG}?": lambda _: str(int(self._watchdog)),
                wire.WATCHDOG_DELAY: self._set_watchdog,
                f"{wire.WATCHDOG_DELAY}?": lambda _: f"{self._watchdog_s:.0f}",
                f"{wire.QUESTIONABLE}?": lambda _: str(wire.PROTECTED * ("watchdog" in self._tripped)),
                "APPLy": self._maybe_delayed(self._apply),
                "APPLy?": lambda _: f'"{self._level_v:.3f},{self._limit_a:.4f}"',
                f"{wire.MEASURE_POWER}?": lambda _: f"{math.prod(self._measure()):.5f}",
                **dict.fromkeys(_CLEARS, lambda _: self._tripped.clear()),
                **dict.fromkeys(("INSTrument[:SELect]", "INSTrument:NSELect"), _select),
                "INSTrument[:SELect]?": lambda _: "OUT1",
                "INSTrument:NSELect?": lambda _: "1",
                **dict.fromkeys(_NOTHING_HAPPENS, lambda _: None),
                **self._stored.commands(),
                "*RST": lambda _: self._reset(),
            },
        )

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        model, serial = setup.model or "SIM-PSU", setup.serial or "SIM-PSU-01"
        return cls(setup.world, setup.faults, name=setup.role, model=model, serial=serial)

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self._execute)

    def trip(self, protection: str = "") -> None:
        """Trip the output; after a `protection` it stays off until that is cleared."""
        self.output = False
        if protection:
            self._tripped.add(protection)
        self._feed_units()

    def _execute(self, message: str) -> str:
        """Execute a message on a remote interface; the watchdog may have switched the output off before."""
        if self._watchdog:
            now_s = self._world.now()
            if now_s - self._last_message_s > self._watchdog_s:
                self._tripped.add("watchdog")
                self._feed_units()
            self._last_message_s = now_s
        return self._interpreter.execute(message)

    @property
    def _is_on(self) -> bool:
        """True if there is voltage at the terminals; OUTP? reports the commanded state."""
        return self.output and "watchdog" not in self._tripped

    def _arm(self, argument: str) -> None:
        on = switch(argument)
        self.faults.carry_out(lambda: self._watch(on))

    def _watch(self, on: bool) -> None:
        self._watchdog, self._last_message_s = on, self._world.now()

    def _set_watchdog(self, argument: str) -> None:
        self._watchdog_s = round(setting(argument, 1.0, WATCHDOG_MAX_S))

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
        self.faults.carry_out(lambda: self._put_output(on))

    def _put_output(self, on: bool) -> None:
        self.output = on
        self._feed_units()

    def _maybe_delayed(self, handler: Handler) -> Handler:
        return lambda argument: self.faults.do(lambda: handler(argument), Refusal)

    def _feed_units(self) -> None:
        self._world.power(self._name, self._is_on and self._level_v > 0)

    def _measure(self) -> tuple[float, float]:
        """Voltage and current at the terminals; a load above the limit reduces the voltage."""
        if not self.faults.active("frozen"):
            load_a = self._world.load_a(self._name) if self._is_on and self._level_v > 0 else 0.0
            current_a = min(load_a, self._limit_a)
            voltage_v = self._level_v * (current_a / load_a if load_a else 1.0) if self._is_on else 0.0
            self._measured = (voltage_v, current_a)
        return self._measured

    def _reset(self) -> None:
        self._tripped.clear()
        self._stored.reset()
        self._watchdog, self._watchdog_s = False, WATCHDOG_S
        self._level_v, self._limit_a, self.output = 0.0, CURRENT_MAX_A, False
        self._feed_units()

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **MEASUREMENT_AND_COMMAND_FAULTS,
        "tripped": FaultEffect(trip),
        "restart": FaultEffect(ScpiInstrument.restart),
    }


def _select(output: str) -> None:
    """Select the only output."""
    if output.upper() not in ("1", "OUT1", "OUTP1", "CH1"):
        raise Refusal(ILLEGAL_VALUE)
