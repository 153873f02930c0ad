"""A Watlow F4T with one control loop: registers connected to the world's chamber.

The modes manual and off are not simulated: a new set point is stored until the loop is in auto.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from itertools import chain
from typing import ClassVar, Self

from drivers.dialects.watlow_f4t.wire import (
    CHAMBER_TEMPERATURE,
    DISPLAY_UNIT,
    DISPLAY_UNIT_SERIAL,
    ControlMode,
    DisplayUnit,
    LoopFormat,
    LoopRegister,
    RampAction,
    RampScale,
)
from drivers.kinds.chamber.words import WordOrder, Words
from simulators.faults.instrument_faults import FaultEffect, FaultKind, FaultPlan
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.modbus import ExceptionCode, ModbusRtuSession, ModbusServer, ModbusTcpSession, RegisterError
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

_UNUSED = (2812, 2816, 2818)  # between the values of a loop; read as zero
_EVENTS = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
_SECONDS = {RampScale.MINUTES: 60.0, RampScale.HOURS: 3600.0}
AFTER_RESTART_C = 25.0  # set point after a power cycle
_POWER_PER_C = 20.0  # % of power for a degree between set point and air


class _Switch(IntEnum):
    OFF = 62
    ON = 63


class SimulatedF4T(SimulatedChamber):
    """Registers of one control loop, the display unit, analog input 1 and the event outputs.

    A set point outside the set-point limits, and a number outside its enumeration, is refused with exception 3; an
    unknown register, and a write to a read-only one, with exception 2. Temperatures are in °C with any `display_unit`.
    """

    def __init__(
        self,
        world: World,
        faults: FaultPlan,
        *,
        unit_id: int = 1,
        loop: int = 1,
        word_order: WordOrder = "low_first",
        set_point_limits_c: tuple[float, float] = (-70.0, 180.0),
        display_unit: DisplayUnit = DisplayUnit.CELSIUS,
        serial_line: bool = False,
    ) -> None:
        super().__init__(world, faults)
        self._serial_line = serial_line
        self._server = ModbusServer(self, unit_id)
        self._form = form = LoopFormat(loop, word_order)
        at = form.address
        self._enumerations: Mapping[int, type[IntEnum]] = {
            at(LoopRegister.CONTROL_MODE): ControlMode,
            at(LoopRegister.RAMP_ACTION): RampAction,
            at(LoopRegister.RAMP_SCALE): RampScale,
            DISPLAY_UNIT: DisplayUnit,
            **dict.fromkeys(_EVENTS, _Switch),
        }
        self._stored: dict[int, Words] = {
            at(LoopRegister.CONTROL_MODE): (ControlMode.AUTO, 0),
            at(LoopRegister.SET_POINT_MIN): form.words(set_point_limits_c[0]),
            at(LoopRegister.SET_POINT_MAX): form.words(set_point_limits_c[1]),
            at(LoopRegister.SET_POINT): form.words(world.thermal.set_point_c),
            at(LoopRegister.MANUAL_POWER): form.words(0.0),
            at(LoopRegister.RAMP_ACTION): (RampAction.OFF, 0),
            at(LoopRegister.RAMP_SCALE): (RampScale.HOURS, 0),
            at(LoopRegister.RAMP_RATE): form.words(60.0),
            DISPLAY_UNIT_SERIAL if serial_line else DISPLAY_UNIT: (display_unit, 0),
            **dict.fromkeys(_EVENTS, (_Switch.OFF, 0)),
        }
        self._measured: Mapping[int, Callable[[], Words]] = {
            at(LoopRegister.POWER_IN_FORCE): lambda: form.words(self._power_percent()),
            at(LoopRegister.SET_POINT_IN_FORCE): lambda: form.words(world.thermal.set_point_c),
            at(LoopRegister.CONTROL_MODE_IN_FORCE): lambda: self._stored[at(LoopRegister.CONTROL_MODE)],
            at(LoopRegister.PROCESS_VALUE): lambda: form.words(self.measured_c()),
            CHAMBER_TEMPERATURE: lambda: form.words(self.measured_c()),
            **{unused + at(LoopRegister.SET_POINT) - LoopRegister.SET_POINT: lambda: (0, 0) for unused in _UNUSED},
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        return cls(
            setup.world, setup.faults, unit_id=options.unit_id, loop=options.loop, word_order=options.word_order,
            serial_line=setup.is_serial_line,
        )  # fmt: skip

    def session(self) -> ModbusTcpSession | ModbusRtuSession:
        """Open a connection."""
        if self._serial_line:
            return ModbusRtuSession(self._server, self._world.now)
        return ModbusTcpSession(self._server)

    def switch_off(self) -> None:
        """Switch the loop off at the front panel."""
        self._enter(ControlMode.OFF)

    def switch_on(self) -> None:
        """Switch the loop to auto at the front panel."""
        self._enter(ControlMode.AUTO)

    def restart(self) -> None:
        """Short power failure: it restarts without a ramp."""
        at, form = self._form.address, self._form
        self._stored[at(LoopRegister.SET_POINT)] = form.words(AFTER_RESTART_C)
        self._stored[at(LoopRegister.RAMP_ACTION)] = (RampAction.OFF, 0)
        self.switch_on()

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read words from `address`; half of a value is returned as is."""
        self._world.look()
        first = address & ~1
        words = list(chain.from_iterable(self._value_at(pair) for pair in range(first, address + count, 2)))
        return words[address - first : address - first + count]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write values from `address` on, all or none; a float only whole, an enumeration with or without its zero."""
        values = [(address + offset, tuple(words[offset : offset + 2])) for offset in range(0, len(words), 2)]
        for where, value in values:
            self._check(where, value)
        for where, value in values:
            self._store(where, value)

    def _value_at(self, address: int) -> Words:
        if address in self._measured:
            return self._measured[address]()
        if address in self._stored:
            return self._stored[address]
        raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)

    def _check(self, address: int, words: Words) -> None:
        if address not in self._stored:
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        if address in self._enumerations:
            allowed = words[0] in list(self._enumerations[address])
        else:
            allowed = len(words) == 2 and self._may_be(address, words)
        if not allowed:
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE)

    def _may_be(self, address: int, words: Words) -> bool:
        try:
            value = self._form.value(words)
        except ValueError:
            return False
        if address == self._form.address(LoopRegister.SET_POINT):
            return self._float(LoopRegister.SET_POINT_MIN) <= value <= self._float(LoopRegister.SET_POINT_MAX)
        return value > 0 or address != self._form.address(LoopRegister.RAMP_RATE)

    def _store(self, address: int, words: Words) -> None:
        set_point = address == self._form.address(LoopRegister.SET_POINT)
        if not (set_point and self.faults.active("stuck")):
            self.faults.do(lambda: self._put(address, words, follows=set_point))

    def _put(self, address: int, words: Words, *, follows: bool) -> None:
        self._stored[address] = (words[0], 0) if address in self._enumerations else words
        if follows or address == self._form.address(LoopRegister.CONTROL_MODE):
            self._follow_set_point()

    def _enter(self, mode: ControlMode) -> None:
        self._stored[self._form.address(LoopRegister.CONTROL_MODE)] = (mode, 0)
        self._follow_set_point()

    def _follow_set_point(self) -> None:
        """Ramp the active set point to the set point, or set it."""
        if self._enumeration(LoopRegister.CONTROL_MODE) != ControlMode.AUTO:
            return
        ramps = self._enumeration(LoopRegister.RAMP_ACTION) in (RampAction.SET_POINT, RampAction.BOTH)
        per_s = _SECONDS[RampScale(self._enumeration(LoopRegister.RAMP_SCALE))]
        rate_c_per_s = self._float(LoopRegister.RAMP_RATE) / per_s if ramps else math.inf
        self._world.ramp(self._float(LoopRegister.SET_POINT), rate_c_per_s)

    def _float(self, register: LoopRegister) -> float:
        return self._form.value(self._stored[self._form.address(register)])

    def _enumeration(self, register: LoopRegister) -> int:
        return self._stored[self._form.address(register)][0]

    def _power_percent(self) -> float:
        mode = self._enumeration(LoopRegister.CONTROL_MODE)
        if mode == ControlMode.AUTO:
            power_percent = _POWER_PER_C * (self._world.thermal.set_point_c - self.measured_c())
            return max(-100.0, min(100.0, power_percent))
        return self._float(LoopRegister.MANUAL_POWER) if mode == ControlMode.MANUAL else 0.0

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "front_panel": FaultEffect(switch_off, switch_on),
        "restart": FaultEffect(restart),
    }
