"""A Watlow F4 S or D: registers of its temperature channel, connected to the world's chamber.

A chamber switched off is not simulated: a new set point is stored until it is switched on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Self

from drivers.dialects.watlow_f4.wire import (
    EVENT_OUTPUTS,
    MODEL_F4,
    START_PROFILE,
    DisplayUnit,
    Register,
    Status,
    TemperatureFormat,
    event_output,
)
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan, sets
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.modbus import ExceptionCode, ModbusRtuSession, ModbusServer, RegisterError
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

SERIAL, SOFTWARE, REVISION = (12, 3456), 3, 201
AFTER_RESTART_C = 25.0  # set point after a power cycle
PROFILE_C = 40.0  # target of the profile
_SWITCHED_OFF = frozenset((103, 104, 105, 107, 108, 109, 110, 111, 115, 319, 1922, 1925))  # features; read as zero
UNIT_FAMILY = 608  # of channel 1; 0 is a temperature


class SimulatedF4(SimulatedChamber):
    """Registers of channel 1, the event outputs, and a profile with the target PROFILE_C.

    A set point outside its limits and an invalid number are refused with exception 3; an unknown register, and a write
    to a read-only one, with exception 2. `memory_writes` counts the writes that wear out the memory: all writes to
    settings, even of the same number. Temperatures are in °C with any `display_unit`.
    """

    def __init__(
        self, world: World, faults: FaultPlan, *, unit_id: int = 1, decimals: int = 1, power_event: int | None = None,
        set_point_limits_c: tuple[float, float] = (-70.0, 180.0), display_unit: DisplayUnit = DisplayUnit.CELSIUS,
        model: int = MODEL_F4,
    ) -> None:  # fmt: skip
        super().__init__(world, faults)
        self.memory_writes = 0
        self.sensor_error = self.alarm = 0
        self._restarts = 0
        self._server = ModbusServer(self, unit_id)
        self._form = form = TemperatureFormat(decimals)
        self._power = event_output(power_event) if power_event is not None else None
        self._profile = (0, 0)  # selected profile, with its step
        low_c, high_c = set_point_limits_c
        self._settings: dict[int, int] = {
            Register.SET_POINT: form.word(world.thermal.set_point_c),
            Register.SET_POINT_MIN: form.word(low_c),
            Register.SET_POINT_MAX: form.word(high_c),
            Register.DECIMALS: decimals,
            Register.DISPLAY_UNIT: display_unit,
        }
        self._outputs = {event_output(number): int(number == power_event) for number in range(1, EVENT_OUTPUTS + 1)}
        self._status = Status.STATIC
        self._readable: Mapping[int, Callable[[], int]] = {
            Register.MODEL: lambda: model,
            Register.SERIAL_FIRST: lambda: SERIAL[0],
            Register.SERIAL_LAST: lambda: SERIAL[1],
            Register.SOFTWARE: lambda: SOFTWARE,
            Register.REVISION: lambda: REVISION,
            Register.PROCESS_VALUE: lambda: form.word(self.measured_c()),
            Register.INPUT_ERROR: lambda: self.sensor_error,
            Register.ALARM_1: lambda: self.alarm,
            Register.ALARM_2: lambda: 0,
            Register.STATUS: lambda: self._status,
            Register.PROFILE_SET_POINT: lambda: form.word(world.thermal.set_point_c),
            Register.PROFILE: lambda: self._profile[0],
            Register.PROFILE_STEP: lambda: self._profile[1],
            UNIT_FAMILY: lambda: 0,
            **dict.fromkeys(_SWITCHED_OFF, lambda: 0),
        }

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file."""
        options = setup.options
        return cls(setup.world, setup.faults, unit_id=options.unit_id, power_event=options.power_event)

    def session(self) -> ModbusRtuSession:
        """Open a connection."""
        return ModbusRtuSession(self._server, self._world.now)

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read words from `address`."""
        self._world.look()
        self._restart_once()
        return [self._word_at(each) for each in range(address, address + count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write words from `address` on, all or none."""
        self._restart_once()
        for where, word in enumerate(words, address):
            self._check(where, word)
        for where, word in enumerate(words, address):
            self._take(where, word)

    def _word_at(self, address: int) -> int:
        if address in self._readable:
            return self._readable[address]()
        for held in (self._settings, self._outputs):
            if address in held:
                return held[address]
        raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)

    def _check(self, address: int, word: int) -> None:
        allowed: Mapping[int, Sequence[int]] = {
            Register.RESUME: (1,),
            Register.HOLD: (1,),
            Register.TERMINATE: (1,),
            Register.PROFILE: range(1, 41),
            Register.PROFILE_STEP: range(1, 257),
            Register.PROFILE_ACTION: (START_PROFILE,),
            Register.DISPLAY_UNIT: tuple(DisplayUnit),
            Register.DECIMALS: range(4),
            **dict.fromkeys(self._outputs, (0, 1)),
        }
        if address == Register.SET_POINT:
            good = self._limit_c(Register.SET_POINT_MIN) <= self._form.value_c(word) <= self._limit_c(
                Register.SET_POINT_MAX
            )  # fmt: skip
        elif address in allowed:
            good = word in allowed[address]
        elif address in self._settings:
            good = True
        else:
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        if not good:
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE)

    def _take(self, address: int, word: int) -> None:
        if address in self._settings:
            self.memory_writes += 1
        self.faults.carry_out(lambda: self._put(address, word))

    def _put(self, address: int, word: int) -> None:
        match address:
            case Register.TERMINATE:
                self._end_profile()
            case Register.HOLD | Register.RESUME if self._status >= Status.PROFILE_RUNS:
                self._status = Status.PROFILE_ON_HOLD if address == Register.HOLD else Status.PROFILE_RUNS
            case Register.PROFILE | Register.PROFILE_STEP:
                number, step = self._profile
                self._profile = (word, step) if address == Register.PROFILE else (number, word)
            case Register.PROFILE_ACTION:
                self.start_profile()
            case _ if address in self._outputs:
                self._outputs[address] = word
                self._follow_set_point()
            case _ if address in self._settings:
                self._settings[address] = word
                self._follow_set_point()

    def start_profile(self) -> None:
        """Start a program at the front panel."""
        self._status = Status.PROFILE_RUNS
        self._world.ramp(PROFILE_C, 1 / 60)

    def _end_profile(self) -> None:
        """End the profile, which switches the set point off: below its lower limit."""
        if self._status >= Status.PROFILE_RUNS:
            self._status = Status.STATIC
            self._settings[Register.SET_POINT] = (self._settings[Register.SET_POINT_MIN] - 1) & 0xFFFF
            self._follow_set_point()

    def _restart_once(self) -> None:
        """Restart after a short power failure."""
        if self.faults.times("restart") > self._restarts:
            self._restarts, self._status = self._restarts + 1, Status.STATIC
            self._settings[Register.SET_POINT] = self._form.word(AFTER_RESTART_C)
            self._follow_set_point()

    def _follow_set_point(self) -> None:
        set_point_c = self._limit_c(Register.SET_POINT)
        is_off = set_point_c < self._limit_c(Register.SET_POINT_MIN)
        is_on = self._power is None or self._outputs[self._power] == 1
        if is_on and not is_off and self._status < Status.PROFILE_RUNS:
            self._world.ramp(set_point_c, math.inf)

    def _limit_c(self, register: Register) -> float:
        return self._form.value_c(self._settings[register])

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": PASSIVE_FAULT,
        "program": FaultEffect(start_profile, _end_profile),
        "alarm": sets("alarm", 1, 0),
        "open_sensor": sets("sensor_error", 1, 0),
    }
