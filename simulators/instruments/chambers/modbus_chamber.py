"""A chamber whose controller a profile describes: the registers of the profile, connected to the world's chamber.

It follows the profile, to rehearse it; that is no evidence of the behaviour of the real controller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from drivers.dialects.modbus_chamber.profile import ChamberProfile, CodeRegister, ValueRegister
from drivers.kinds.chamber.words import Words
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan
from simulators.instruments.chambers.chamber import CHAMBER_FAULT_EFFECTS, SimulatedChamber
from simulators.instruments.modbus import (
    READ,
    READ_INPUT,
    WRITE_MANY,
    ExceptionCode,
    ModbusRtuSession,
    ModbusServer,
    ModbusTcpSession,
    RegisterError,
)
from simulators.instruments.setup import InstrumentSetup
from simulators.world import World

AFTER_RESTART_C = 25.0  # set point after a power cycle
LIMITS_C = (-70.0, 180.0)  # values in the registers
ELSEWHERE_C = 40.0  # target of another mode


class SimulatedProfile(SimulatedChamber):
    """Holding and input registers of a profile, numbered separately.

    A set point beyond the limits, a mode that is not in the profile and half of a value are refused with exception 3;
    an unknown register, and a write to a read-only one, with exception 2; a function that the profile does not use with
    exception 1.
    """

    def __init__(
        self, world: World, faults: FaultPlan, profile: ChamberProfile, *, unit_id: int = 1, serial_line: bool = False
    ) -> None:
        super().__init__(world, faults)
        self.profile = profile
        self.alarms = [each.quiet[0] for each in profile.alarms]
        self.limits_c = (profile.range.min, profile.range.max) if profile.range is not None else LIMITS_C
        self.mode = profile.mode.follows[0] if profile.mode is not None else 0
        self._serial_line, self._restarts = serial_line, 0
        self._set_point = self._words(profile.set_point, world.thermal.set_point_c)
        ramp = profile.ramp
        self._rate = self._words(ramp.rate, 60.0 if ramp.per == "hour" else 1.0) if ramp is not None else ()
        self._ramp_on = 0
        self._expected = [each.is_ for each in profile.must_be]
        functions = {register.read for _, register in profile.registers()} | _written_by(profile)
        self._server = ModbusServer(self, unit_id, frozenset(functions), inputs=_Inputs(self))

    @classmethod
    def of(cls, setup: InstrumentSetup) -> Self:
        """Create from a bench file, whose check has made sure of the profile."""
        options = setup.options
        return cls(
            setup.world, setup.faults, options.profile.content, unit_id=options.unit_id,
            serial_line=setup.is_serial_line,
        )  # fmt: skip

    def session(self) -> ModbusTcpSession | ModbusRtuSession:
        """Open a connection."""
        if self._serial_line:
            return ModbusRtuSession(self._server, self._world.now)
        return ModbusTcpSession(self._server)

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read words of holding registers from `address`."""
        return self.read_by(READ, address, count)

    def read_by(self, function: int, address: int, count: int) -> Sequence[int]:
        """Read words from `address` by the registers of a function."""
        self._world.look()
        self._restart_once()
        held = {
            register.address + offset: word
            for register, words in self._held()
            if register.read == function
            for offset, word in enumerate(words)
        }
        if any(each not in held for each in range(address, address + count)):
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)
        return [held[each] for each in range(address, address + count)]

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write one value."""
        self._restart_once()
        profile = self.profile
        if address == profile.set_point.address:
            self._take_set_point(tuple(words))
        elif profile.mode is not None and address == profile.mode.address and profile.mode.start is not None:
            self._check(tuple(words) in [(word,) for word in self._modes()])
            self._take(mode=words[0])
        elif profile.ramp is not None and address == profile.ramp.rate.address:
            self._check(len(words) == profile.ramp.rate.count and self._value(profile.ramp.rate, words) > 0)
            self._take(rate=tuple(words))
        elif profile.ramp is not None and profile.ramp.on is not None and address == profile.ramp.on.address:
            self._check(len(words) == 1)
            self._take(ramp_on=words[0])
        else:
            raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)

    def take_over(self, mode: int) -> None:
        """Take control at the front panel: another mode, with another target of the air."""
        self.mode = mode
        self._world.ramp(ELSEWHERE_C, 1 / 60)

    def _held(self) -> list[tuple[CodeRegister, Words]]:
        """All registers of the profile with their content."""
        profile, set_point_c = self.profile, self._world.thermal.set_point_c
        held: list[tuple[CodeRegister, Words]] = [
            (profile.process_value, self._words(profile.process_value, self.measured_c())),
            (profile.set_point, self._set_point),
        ]
        held += zip(profile.must_be, ((word,) for word in self._expected), strict=True)
        held += zip(profile.alarms, ((word,) for word in self.alarms), strict=True)
        if profile.set_point_in_force is not None:
            held.append((profile.set_point_in_force, self._words(profile.set_point_in_force, set_point_c)))
        if profile.limits is not None:
            at = (profile.limits.min, profile.limits.max)
            held += [(each, self._words(each, limit_c)) for each, limit_c in zip(at, self.limits_c, strict=True)]
        if profile.mode is not None:
            held.append((profile.mode, (self.mode,)))
        if profile.ramp is not None:
            held.append((profile.ramp.rate, self._rate))
            if profile.ramp.on is not None:
                held.append((profile.ramp.on, (self._ramp_on,)))
        return held

    def _take_set_point(self, words: Words) -> None:
        low_c, high_c = self.limits_c
        self._check(len(words) == self.profile.set_point.count)
        self._check(low_c <= self._value(self.profile.set_point, words) <= high_c)
        self.faults.carry_out(lambda: self._put_set_point(words))

    def _put_set_point(self, words: Words) -> None:
        self._set_point = words
        self._follow()

    def _take(self, *, mode: int | None = None, rate: Words | None = None, ramp_on: int | None = None) -> None:
        self.faults.carry_out(lambda: self._put(mode, rate, ramp_on))

    def _put(self, mode: int | None, rate: Words | None, ramp_on: int | None) -> None:
        self._rate = rate or self._rate
        self._ramp_on = self._ramp_on if ramp_on is None else ramp_on
        if mode is not None:
            self.mode = mode
            self._follow()

    def _follow(self) -> None:
        """Ramp the active set point to the set point, or set it, if the mode follows the set point."""
        profile = self.profile
        if profile.mode is not None and self.mode not in profile.mode.follows:
            return
        ramp, rate_c_per_s = profile.ramp, math.inf
        if ramp is not None and (ramp.on is None or self._ramp_on == ramp.on.value):
            rate_c_per_s = self._value(ramp.rate, self._rate) / (3600 if ramp.per == "hour" else 60)
        self._world.ramp(self._value(profile.set_point, self._set_point), rate_c_per_s)

    def _modes(self) -> Sequence[int]:
        mode = self.profile.mode
        return [] if mode is None else [*mode.follows, *mode.off, *mode.other.values()]

    def _restart_once(self) -> None:
        """Restart after a short power failure."""
        if self.faults.times("restart") > self._restarts:
            self._restarts, self._ramp_on = self._restarts + 1, 0
            self._set_point = self._words(self.profile.set_point, AFTER_RESTART_C)
            self._follow()

    def _words(self, register: ValueRegister, value: float) -> Words:
        return self.profile.form(register).words(value)

    def _value(self, register: ValueRegister, words: Sequence[int]) -> float:
        try:
            return self.profile.form(register).value(words)
        except ValueError:
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE) from None

    @staticmethod
    def _check(allowed: bool) -> None:
        if not allowed:
            raise RegisterError(ExceptionCode.ILLEGAL_VALUE)

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CHAMBER_FAULT_EFFECTS,
        "restart": PASSIVE_FAULT,
    }


@dataclass(frozen=True, slots=True)
class _Inputs:
    """The read-only input registers of a controller."""

    of: SimulatedProfile

    def read(self, address: int, count: int) -> Sequence[int]:
        """Read words from `address`."""
        return self.of.read_by(READ_INPUT, address, count)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Refuse the write."""
        raise RegisterError(ExceptionCode.ILLEGAL_ADDRESS)


def _written_by(profile: ChamberProfile) -> set[int]:
    """Functions that write the registers of the profile."""
    values = [profile.set_point, *([profile.ramp.rate] if profile.ramp is not None else [])]
    functions: set[int] = {WRITE_MANY if each.count == 2 else each.write for each in values}
    if profile.mode is not None and profile.mode.start is not None:
        functions.add(profile.mode.write)
    if profile.ramp is not None and profile.ramp.on is not None:
        functions.add(profile.ramp.on.write)
    return functions
