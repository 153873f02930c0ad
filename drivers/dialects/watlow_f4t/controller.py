"""One control loop of an F4T: registers read and written for a chamber."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.description import Setup
from drivers.dialects.watlow_f4t.description import F4TOptions
from drivers.dialects.watlow_f4t.wire import (
    BLOCK_COUNT,
    BLOCK_FIRST,
    DISPLAY_UNIT,
    DISPLAY_UNIT_SERIAL,
    ControlMode,
    DisplayUnit,
    LoopBlock,
    LoopFormat,
    LoopRegister,
    RampAction,
    RampScale,
    mode_name,
)
from drivers.errors import InstrumentFault, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.ramp import ARRIVED_WITHIN_C
from drivers.kinds.chamber.registers import RegisterController, spelled_by
from drivers.kinds.chamber.words import COLDEST_C, HOTTEST_C, Words
from drivers.recognised import as_stated
from drivers.values import Identity

_CONTROL: Mapping[int, Control] = {ControlMode.AUTO: Control.SET_POINT, ControlMode.OFF: Control.IDLE}
NARROWEST_C = 1.0  # closer set-point limits are swapped words, which decode to almost zero


class F4TLoop(RegisterController):
    """A Controller that ramps by itself; its loop can be switched to auto only by a person.

    The controller reports no names: it is identified by its set-point limits.
    """

    can_start = False

    def __init__(self, setup: Setup[F4TOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup)
        self._block_reads = setup.options.block_reads
        self._form = LoopFormat(setup.options.loop, setup.options.word_order)

    def _identity(self) -> Identity:
        """Names stated in the bench file; the fingerprint is reported by the controller."""
        low_c, high_c = self.limits_c or (0.0, 0.0)
        fingerprint = f"display unit °C, set point {low_c:g} to {high_c:g} °C"
        return as_stated(self._pin, fingerprint, maker="Watlow", model="F4T")

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read active set point, mode and process value; the set point itself only if it may differ."""
        block = await (self._block() if self._block_reads else self._block_singly())
        target_c = commanded_c
        # While the active set point rests at the command, the set point equals it, because a changed one would be
        # followed at once.
        if commanded_c is None or abs(block.set_point_in_force - commanded_c) > ARRIVED_WITHIN_C:
            target_c = await self._number(LoopRegister.SET_POINT)
        why = f"control loop {self._form.loop} is not in auto, mode {mode_name(block.mode)}"
        control = _CONTROL.get(block.mode, Control.FOREIGN)
        return ControllerState(block.process_value, block.set_point_in_force, target_c or 0.0, control, why)

    async def command(self, temperature_c: float) -> None:
        """Write the set point and read it back."""
        await self._set(LoopRegister.SET_POINT, self._form.words(temperature_c))

    def as_stored(self, temperature_c: float) -> float:
        """Set point as stored: the nearest float32."""
        return self._form.value(self._form.words(temperature_c))

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Set the ramp rate of the next set point."""
        await self._set(LoopRegister.RAMP_SCALE, (RampScale.MINUTES,))
        await self._set(LoopRegister.RAMP_RATE, self._form.words(rate_c_per_min))
        await self._set(LoopRegister.RAMP_ACTION, (RampAction.SET_POINT,))

    async def take_control(self) -> None:
        """Raise InstrumentFault: only the operator can switch a loop to auto."""
        mode = (await self._registers.read(self._form.address(LoopRegister.CONTROL_MODE_IN_FORCE), 1))[0]
        raise InstrumentFault(
            self._link.device, f"control loop {self._form.loop} is not in auto", received=f"mode {mode_name(mode)}",
            remedy="Switch the loop to auto at the controller, and find out who switched it.",
        )  # fmt: skip

    async def _block(self) -> LoopBlock:
        """Read the block in one request, so that its values are simultaneous."""
        address = self._form.address(BLOCK_FIRST)
        return self._decode(await self._registers.read(address, BLOCK_COUNT), self._form.block, address)

    async def _block_singly(self) -> LoopBlock:
        """Read the block with one request for each value, for a controller that refuses the block."""
        in_force = await self._number(LoopRegister.SET_POINT_IN_FORCE)
        (mode,) = await self._registers.read(self._form.address(LoopRegister.CONTROL_MODE_IN_FORCE), 1)
        return LoopBlock(in_force, mode, await self._number(LoopRegister.PROCESS_VALUE))

    async def _number(self, register: LoopRegister) -> float:
        address = self._form.address(register)
        return self._decode(await self._registers.read(address, 2), self._form.value, address)

    async def _set(self, register: LoopRegister, words: Words) -> None:
        name = register.name.lower().replace("_", " ")
        spelled = spelled_by(self._form.value) if len(words) > 1 else lambda words: str(words[0])
        await self._registers.set(self._form.address(register), words, name, spelled)

    async def _identify(self) -> None:
        register = DISPLAY_UNIT_SERIAL if self._link.address.is_serial_line else DISPLAY_UNIT
        (unit,) = await self._link.read(register, 1)
        if unit != DisplayUnit.CELSIUS:
            raise WrongIdentity(
                self._link.device, "the display unit of the controller is not °C", sent=f"read register {register}",
                received="30, which is °F" if unit == DisplayUnit.FAHRENHEIT else f"{unit}, expected 15",
                remedy="Set the display unit to °C at the controller.",
            )  # fmt: skip
        limits_c = await self._read_limits()
        if self.limits_c not in (None, limits_c):
            raise WrongIdentity(
                self._link.device,
                "another controller than before, or its set-point limits were changed",
                received=_range(limits_c), remedy="Check the network address in the bench file, then start again.",
            )  # fmt: skip
        self.limits_c = limits_c

    async def _read_limits(self) -> tuple[float, float]:
        low_c, high_c = [
            self._decode(await self._link.read(address, 2), self._form.value, address)
            for address in map(self._form.address, (LoopRegister.SET_POINT_MIN, LoopRegister.SET_POINT_MAX))
        ]
        if low_c < COLDEST_C or high_c > HOTTEST_C or high_c - low_c < NARROWEST_C:
            raise WrongIdentity(
                self._link.device, "the set-point limits of the controller are implausible",
                received=_range((low_c, high_c)),
                remedy="Check options.word_order in the bench file; the data map of the controller must be 1.",
            )  # fmt: skip
        return low_c, high_c


def _range(limits_c: tuple[float, float]) -> str:
    return f"set points from {limits_c[0]:g} to {limits_c[1]:g} °C"


class WatlowF4T(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[F4TOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, F4TLoop(setup), setup.limits, setup.safe, setup.options)
