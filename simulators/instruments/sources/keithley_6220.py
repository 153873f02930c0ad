"""A Keithley 6220 or 6221 with a load resistor: range, level, compliance, interlock, error queue, and waves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

from drivers.dialects.keithley_6220 import wire
from drivers.dialects.keithley_6220.wire import Condition, Terminator
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan, sets
from simulators.instruments.scpi import (
    OUT_OF_RANGE,
    SETTINGS_CONFLICT,
    Handler,
    Interpreter,
    LineSession,
    Refusal,
    setting,
    switch,
)
from simulators.instruments.setup import InstrumentSetup
from simulators.instruments.sources.keithley_wave import Waves
from simulators.instruments.sources.loaded_source import LoadedSource
from simulators.instruments.stored_settings import StoredSettings, stored_number, stored_switch, stored_word
from simulators.world import World

_LEVEL_MAX_A = wire.OVER_RANGE * wire.RANGES_A[-1]
MEASUREMENT_SUMMARY, OPERATION_SUMMARY = 1 << 0, 1 << 7  # bit of the status byte
_REGISTER = stored_number(0, 0, 65535, lambda value: str(round(value)))
_ERROR_QUERIES = ("SYSTem:ERRor[:NEXT]?", "STATus:QUEue[:NEXT]?")
_STORED = {
    "[SOURce:]DELay": stored_number(1.0, 1e-3, 999999.999, lambda delay_s: f"{delay_s:.6E}"),
    "[SOURce:]CURRent:FILTer[:STATe]": stored_switch("0"),
    "OUTPut:ISHield": stored_word("OLOW", "GUARd", "OLOW"),
    "OUTPut:LTEarth": stored_switch("0"),
    "OUTPut:RESPonse": stored_word("FAST", "FAST", "SLOW"),
    "DISPlay:ENABle": stored_switch("1"),
    "STATus:MEASurement:ENABle": _REGISTER,
    "STATus:OPERation:ENABle": _REGISTER,
    "STATus:QUEStionable:ENABle": _REGISTER,
}


class SimulatedKeithley(LoadedSource):
    """A source in front of `load_ohm`; it answers with its terminator.

    On a serial line a command ends at CR, or at LF if set so in its menu; over TCP at LF if its terminator has one.
    `interlock_closed` is the rear contact, `hot` the thermal switch. `stuck`: settings are accepted and not executed.
    There are no measured values for `frozen`. A 6221 also generates waves, represented by their mean current.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, serial: str = "SIM-6220-01", load_ohm: float = 100.0,
        terminator: Terminator = "crlf", is_serial_line: bool = True, model: str = "6220",
    ) -> None:  # fmt: skip
        super().__init__(world, faults, load_ohm)
        self.hot = False
        self.range_a, self.auto_range = wire.RANGES_A[-1], True
        self.compliance_v = 10.0
        self._interlock_closed = True
        self._end = end = wire.TERMINATORS[terminator]
        self._acts_on = end[:1] if is_serial_line or b"\n" not in end else b"\n"
        self._stored = StoredSettings(_STORED)
        self._waves = Waves(self._energise, world.now) if model == "6221" else None
        identity = f"KEITHLEY INSTRUMENTS INC.,MODEL {model},{serial},D04  /700x"
        self._interpreter = Interpreter(
            identity, self._commands(), separator="; ", summary=self._summary, error_queries=_ERROR_QUERIES
        )

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        serial = setup.serial or "SIM-6220-01"
        return cls(
            setup.world, setup.faults, serial=serial, terminator=setup.options.terminator,
            is_serial_line=setup.is_serial_line, model="6221" if "6221" in setup.model else "6220",
        )  # fmt: skip

    @property
    def current_a(self) -> float:
        """True mean output current."""
        if self._waves is not None and self._waves.runs and self.output:
            return self._waves.mean_a
        return super().current_a

    def session(self) -> LineSession:
        """Open a connection."""
        return LineSession(self._interpreter.execute, end=self._acts_on, answer_end=self._end)

    @property
    def interlock_closed(self) -> bool:
        """True if the rear contact is closed; opening it switches the output off."""
        return self._interlock_closed

    @interlock_closed.setter
    def interlock_closed(self, closed: bool) -> None:
        self._interlock_closed = closed
        if not closed:
            self.put_output(False)

    def _commands(self) -> dict[str, Handler]:
        return {
            wire.LEVEL: self.unless_stuck(self._set_level),
            f"{wire.LEVEL}?": lambda _: f"{self.level_a:.6E}",
            wire.RANGE: self.unless_stuck(self._set_range),
            f"{wire.RANGE}?": lambda _: f"{self.range_a:.6E}",
            wire.AUTO_RANGE: self.unless_stuck(self._set_auto_range),
            f"{wire.AUTO_RANGE}?": lambda _: str(int(self.auto_range)),
            wire.COMPLIANCE: self.unless_stuck(self._set_compliance),
            f"{wire.COMPLIANCE}?": lambda _: f"{self.compliance_v:.6E}",
            wire.OUTPUT: self.unless_stuck(self._switch),
            f"{wire.OUTPUT}?": lambda _: str(int(self.output)),
            f"{wire.CONDITION}?": lambda _: str(int(self._condition())),
            "STATus:MEASurement[:EVENt]?": lambda _: str(int(self._condition())),
            "STATus:QUEStionable[:EVENt]?": lambda _: "0",
            "STATus:QUEStionable:CONDition?": lambda _: "0",
            "[SOURce:]CLEar[:IMMediate]": self.unless_stuck(lambda _: self._clear()),
            "[SOURce:]DELTa:NVPResent?": lambda _: "0",  # no nanovoltmeter on its second line
            "SYSTem:BEEPer[:IMMediate]": lambda _: None,
            "STATus:QUEue:CLEar": lambda _: self._interpreter.clear_errors(),
            "SYSTem:CLEar": lambda _: self._interpreter.clear_errors(),
            "*RST": lambda _: self._reset(),
            **self._stored.commands(),
            **({} if self._waves is None else self._waves.commands()),
        }

    def _set_level(self, argument: str) -> None:
        level_a = setting(argument, -_LEVEL_MAX_A, _LEVEL_MAX_A)
        if self.auto_range:
            self.range_a = _range_for(level_a)
        if abs(level_a) > wire.OVER_RANGE * self.range_a:
            raise Refusal(OUT_OF_RANGE)
        step_a = wire.step_a(self.range_a)
        self._world.before_change()
        self.level_a = round(level_a / step_a) * step_a

    def _set_range(self, argument: str) -> None:
        range_a = _range_for(setting(argument, -_LEVEL_MAX_A, _LEVEL_MAX_A))
        if abs(self.level_a) > wire.OVER_RANGE * range_a:
            raise Refusal(SETTINGS_CONFLICT)
        self.range_a, self.auto_range = range_a, False

    def _set_auto_range(self, argument: str) -> None:
        self.auto_range = switch(argument)
        if self.auto_range:
            self.range_a = _range_for(self.level_a)

    def _set_compliance(self, argument: str) -> None:
        compliance_v = setting(argument, wire.COMPLIANCE_MIN_V, wire.COMPLIANCE_MAX_V)
        self.compliance_v = round(compliance_v / wire.COMPLIANCE_STEP_V) * wire.COMPLIANCE_STEP_V

    def _switch(self, argument: str) -> None:
        self._energise(switch(argument))

    def _energise(self, on: bool) -> None:
        if on and not self.interlock_closed:
            raise Refusal(SETTINGS_CONFLICT)
        self.put_output(on)

    def _condition(self) -> Condition:
        condition = Condition(0)
        if not self.interlock_closed:
            condition |= Condition.INTERLOCK
        if self.hot:
            condition |= Condition.OVER_TEMPERATURE
        if self.output and abs(self.level_a) * self.load_ohm > self.compliance_v:
            condition |= Condition.COMPLIANCE
        return condition

    def _summary(self) -> int:
        """Status byte bits of the measurement and the operation registers."""
        measured = int(self._condition()) & int(self._stored["STATus:MEASurement:ENABle"])
        happened = 0 if self._waves is None else int(self._waves.events) & int(self._stored["STATus:OPERation:ENABle"])
        return (MEASUREMENT_SUMMARY if measured else 0) | (OPERATION_SUMMARY if happened else 0)

    def _clear(self) -> None:
        """Switch the output off and set the level to zero."""
        self.put_output(False)
        self.level_a = 0.0

    def _reset(self) -> None:
        self._stored.reset()
        if self._waves is not None:
            self._waves.reset()
        self.level_a, self.compliance_v = 0.0, 10.0
        self.range_a, self.auto_range = wire.RANGES_A[-1], True
        self.put_output(False)

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **LoadedSource.FAULT_EFFECTS,
        "interlock": sets("interlock_closed", False, True),
    }


def _range_for(level_a: float) -> float:
    return next(range_a for range_a in wire.RANGES_A if abs(level_a) <= wire.OVER_RANGE * range_a)
