"""A Yokogawa GS200 with a load resistor: function, range, level, voltage limit and error queue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

from drivers.dialects.yokogawa_gs200 import wire
from drivers.dialects.yokogawa_gs200.wire import Condition, Function
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan
from simulators.instruments.scpi import (
    ILLEGAL_VALUE,
    OUT_OF_RANGE,
    SETTINGS_CONFLICT,
    Handler,
    Interpreter,
    LineSession,
    Refusal,
    asked,
    setting,
    switch,
)
from simulators.instruments.setup import InstrumentSetup
from simulators.instruments.sources.gs200_program import Program
from simulators.instruments.sources.loaded_source import LoadedSource
from simulators.instruments.stored_settings import StoredSettings, stored_switch, stored_word
from simulators.world import World

ERROR_QUERIES = ("STATus:ERRor?", "SYSTem:ERRor[:NEXT]?")
_RANGES_V = (10e-3, 100e-3, 1.0, 10.0, 30.0)
_FUNCTIONS: dict[str, Function] = {"CURR": "CURR", "CURRENT": "CURR", "VOLT": "VOLT", "VOLTAGE": "VOLT"}
_CURRENT_LIMITS_A = (1e-3, 200e-3)
_STORED = {
    "SENSe:REMote": stored_switch("0"),
    "SENSe:GUARd": stored_switch("0"),
    "ROUTe:BNCOut": stored_word("TRIG", "TRIGger", "OUTPut", "READy"),
    "ROUTe:BNCIn": stored_word("TRIG", "TRIGger", "OUTPut"),
}


class SimulatedGS200(LoadedSource):
    """A source in front of `load_ohm`; by default a voltage source, and a new function is off and at zero.

    Third-party programs use either of `error_queries`; it is unknown whether every firmware supports both. `emergency`
    is its own protection. There are no measured values for `frozen`.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, serial: str = "SIM-GS200-01", load_ohm: float = 100.0,
        error_queries: Sequence[str] = ERROR_QUERIES,
    ) -> None:  # fmt: skip
        self._level = 0.0
        self._program = Program(world.now, self._run_from)
        super().__init__(world, faults, load_ohm)
        self.function: Function = "VOLT"
        self.emergency = False
        self._stored = StoredSettings(_STORED)
        self._reset()
        identity = f"YOKOGAWA,GS210,{serial},2.02"
        self._interpreter = Interpreter(identity, self._commands(), error_queries=error_queries)

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        return cls(setup.world, setup.faults, serial=setup.serial or "SIM-GS200-01")

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self._interpreter.execute)

    @property
    def level_a(self) -> float:
        """Level that is set, or that of the running program."""
        level = self._program.level
        return self._level if level is None else level

    @level_a.setter
    def level_a(self, level: float) -> None:
        self._program.end()
        self._level = level

    def put_output(self, on: bool) -> None:
        """Switch the output, which also ends a program."""
        super().put_output(on)
        self._hold()

    @property
    def current_a(self) -> float:
        """True output current."""
        if self.function == "CURR" or not self.output:
            return super().current_a
        return max(-self.current_limit_a, min(self.level_a / self.load_ohm, self.current_limit_a))

    def trip(self) -> None:
        """Trip its protection: the output switches off."""
        self.put_output(False)

    def _commands(self) -> dict[str, Handler]:
        return {
            wire.FUNCTION: self.unless_stuck(self._set_function),
            f"{wire.FUNCTION}?": lambda _: self.function,
            wire.RANGE: self.unless_stuck(self._set_range),
            f"{wire.RANGE}?": lambda _: _engineering(self.range_a),
            wire.LEVEL: self.unless_stuck(self._set_level),
            wire.AUTO_LEVEL: self.unless_stuck(self._set_auto_level),
            f"{wire.LEVEL}?": lambda _: f"{self.level_a:+.5E}",
            wire.COMPLIANCE: self.unless_stuck(self._set_compliance),
            f"{wire.COMPLIANCE}?": lambda which: f"+{_engineering(self._compliance(which))}",
            wire.CURRENT_LIMIT: self.unless_stuck(self._set_current_limit),
            f"{wire.CURRENT_LIMIT}?": lambda _: f"{self.current_limit_a:+.5E}",
            wire.OUTPUT: self.unless_stuck(lambda argument: self.put_output(switch(argument))),
            f"{wire.OUTPUT}?": lambda _: str(int(self.output)),
            f"{wire.CONDITION}?": lambda _: str(int(self._condition())),
            f"{wire.EVENT}?": lambda _: str(int(self._condition()) | int(self._program.take_events())),
            "*OPT?": lambda _: "0",
            "SYSTem:LFRequency?": lambda _: "50",
            "SYSTem:REMote": lambda _: None,
            "SYSTem:LOCal": lambda _: None,
            "*RST": lambda _: self._reset(),
            **self._stored.commands(),
            **self._program.commands(),
            "PROGram:HOLD": lambda _: self._hold(),
        }

    @property
    def _ranges(self) -> tuple[float, ...]:
        return wire.RANGES_A if self.function == "CURR" else _RANGES_V

    def _most(self, range_: float) -> float:
        return wire.max_a(range_) if self.function == "CURR" else min(wire.OVER_RANGE * range_, 32.0)

    def _set_function(self, argument: str) -> None:
        function = _FUNCTIONS.get(argument.upper())
        if function is None:
            raise Refusal(ILLEGAL_VALUE)
        if function != self.function:
            self.put_output(False)
            self.function, self.level_a = function, 0.0
            self.range_a = self._ranges[0]

    def _set_range(self, argument: str) -> None:
        range_ = self._wanted_range(argument.upper())
        if abs(self.level_a) > self._most(range_):
            raise Refusal(SETTINGS_CONFLICT)
        self.range_a = range_

    def _wanted_range(self, argument: str) -> float:
        place = self._ranges.index(self.range_a)
        places = {"MIN": 0, "MAX": -1, "DOWN": max(place - 1, 0), "UP": min(place + 1, len(self._ranges) - 1)}
        if argument in places:
            return self._ranges[places[argument]]
        return self._range_for(setting(argument, 0, self._ranges[-1]), over=1.0)

    def _set_level(self, argument: str) -> None:
        level = setting(argument, -self._most(self._ranges[-1]), self._most(self._ranges[-1]))
        if abs(level) > self._most(self.range_a) * (1 + 1e-9):
            raise Refusal(OUT_OF_RANGE)
        if self._program.edited:
            self._program.add(level)
        else:
            self._put_level(level)

    def _hold(self) -> None:
        self.level_a = self.level_a  # ends its program

    def _run_from(self) -> float:
        """Start level of a program; raises Refusal with the output off."""
        if not self.output:
            raise Refusal(SETTINGS_CONFLICT)
        return self.level_a

    def _set_auto_level(self, argument: str) -> None:
        level = setting(argument, -self._most(self._ranges[-1]), self._most(self._ranges[-1]))
        self.range_a = self._range_for(abs(level), over=wire.OVER_RANGE)
        self._put_level(level)

    def _put_level(self, level: float) -> None:
        step = wire.step_a(self.range_a) if self.function == "CURR" else 1e-5 * self.range_a
        self._world.before_change()
        self.level_a = round(level / step) * step

    def _set_compliance(self, argument: str) -> None:
        self.compliance_v = float(round(setting(argument, wire.COMPLIANCE_MIN_V, wire.COMPLIANCE_MAX_V)))

    def _compliance(self, which: str) -> float:
        return asked(which, self.compliance_v, wire.COMPLIANCE_MIN_V, wire.COMPLIANCE_MAX_V)

    def _set_current_limit(self, argument: str) -> None:
        self.current_limit_a = setting(argument, *_CURRENT_LIMITS_A)

    def _condition(self) -> Condition:
        condition = Condition.EMERGENCY if self.emergency else Condition(0)
        if self.function == "CURR" and self.output and abs(self.level_a) * self.load_ohm > self.compliance_v:
            condition |= Condition.HIGH_LIMITING if self.level_a > 0 else Condition.LOW_LIMITING
        return condition

    def _range_for(self, value: float, *, over: float) -> float:
        """Smallest range for a value."""
        return next(range_ for range_ in self._ranges if value <= over * range_ * (1 + 1e-9))

    def _reset(self) -> None:
        self._stored.reset()
        self._program.reset()
        self.put_output(False)
        self.function, self.level_a = "VOLT", 0.0
        self.range_a = _RANGES_V[-1]
        self.compliance_v, self.current_limit_a = wire.COMPLIANCE_MAX_V, _CURRENT_LIMITS_A[1]

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **LoadedSource.FAULT_EFFECTS,
        "tripped": FaultEffect(trip),
    }


def _engineering(value: float) -> str:
    """Format as in the manual (+30E+0), and the range as expected by a third-party program (10E-3)."""
    exponent = 0 if value >= 1 else -3
    return f"{value / 10**exponent:g}E{exponent:+d}"
