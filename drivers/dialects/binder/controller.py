"""Binder's controllers: registers read and written for a chamber."""

from __future__ import annotations

from contextlib import suppress
from typing import ClassVar

from drivers.description import Setup
from drivers.dialects.binder.description import BinderOptions
from drivers.dialects.binder.wire import (
    ALARM,
    IDLE_LINE,
    LINES,
    MODE,
    PROGRAM_STOP,
    Mode,
    mode_of,
    registers_of,
    value_c,
    words,
)
from drivers.errors import BadAnswer, InstrumentFault, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.ramp import ARRIVED_WITHIN_C
from drivers.kinds.chamber.registers import RegisterController, hexadecimal, spelled_by
from drivers.recognised import as_stated
from drivers.timing.readback import read_back
from drivers.values import Identity


class _Controller(RegisterController):
    """The common part of MB1 and MB2; a Controller except for the temperature set point.

    The controller reports no names and no limits; it is recognised by plausible temperatures in its registers.
    """

    can_start = True
    model: ClassVar[str]

    def __init__(self, setup: Setup[BinderOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup)
        self._options = setup.options
        self._at = registers_of(setup.options.controller, setup.options.set_point, swapped=setup.options.swapped)

    def _identity(self) -> Identity:
        """Names stated in the bench file; the fingerprint is reported by the controller."""
        fingerprint = f"temperatures in the registers of an {self.model}"
        return as_stated(self._pin, fingerprint, maker="Binder", model=self.model)

    def as_stored(self, temperature_c: float) -> float:
        """Set point as stored: the nearest float32."""
        return value_c(words(temperature_c))

    async def _set(self, temperature_c: float) -> None:
        await self._registers.set(self._at.set_point, words(temperature_c), "set point", spelled_by(value_c, " °C"))

    async def _temperature(self, address: int) -> float:
        return self._decode(await self._registers.read(address, 2), value_c, f"{address:#06x}")

    async def _identify(self) -> None:
        try:
            for address in (self._at.process_value, self._at.set_point):
                self._decode(await self._link.read(address, 2), value_c, f"{address:#06x}")
            await self._check_more()
        except (Refused, BadAnswer) as problem:
            raise WrongIdentity(
                self._link.device, f"the answers do not fit an {self.model}", sent=problem.sent,
                received=problem.received or problem.problem,
                remedy="Check options.controller and the address in the bench file.",
            ) from problem  # fmt: skip
        self.limits_c = self._options.range.min, self._options.range.max

    async def _check_more(self) -> None:
        """Check the properties of one model; raises Refused or BadAnswer."""


class Mb1(_Controller):
    """A Controller that follows one of two set points, by its mode, or a program."""

    model = "MB1"

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read temperatures, mode and alarm."""
        (mode,) = await self._registers.read(MODE, 1)
        (alarm,) = await self._registers.read(ALARM, 1)
        control, why = Control.FOREIGN, f"mode {_mode_name(mode)}"
        if alarm:
            why = f"alarm {alarm:#x}"
        elif mode == mode_of(self._options.set_point):
            control, why = Control.SET_POINT, ""
        elif mode == Mode.IDLE:
            control = Control.IDLE
        return ControllerState(
            await self._temperature(self._at.process_value), await self._temperature(self._at.set_point_in_force),
            await self._temperature(self._at.set_point), control, why,
        )  # fmt: skip

    async def command(self, temperature_c: float) -> None:
        """Write the set point and read it back; if its mode is active, write the mode again after it."""
        await self._set(temperature_c)
        mode = mode_of(self._options.set_point)
        if await self._registers.read(MODE, 1) == (mode,):
            await self._registers.set(MODE, (mode,), "mode", hexadecimal)

    async def take_control(self) -> None:
        """Activate the mode of the set point; InstrumentFault during an alarm."""
        (alarm,) = await self._registers.read(ALARM, 1)
        if alarm:
            raise InstrumentFault(
                self._link.device, "the controller has an alarm", received=f"{alarm:#x}",
                remedy="Find its cause, then acknowledge it at the controller; this is not possible by remote.",
            )  # fmt: skip
        await self._registers.set(MODE, (mode_of(self._options.set_point),), "mode", hexadecimal)

    async def _check_more(self) -> None:
        (mode,) = await self._link.read(MODE, 1)
        if mode not in list(Mode):
            raise BadAnswer(
                self._link.device, "no mode of this controller", sent=f"read 1 register at {MODE:#06x}",
                received=f"{mode:#x}",
            )  # fmt: skip


class Mb2(_Controller):
    """A Controller that follows its manual set point unless it is idle or a program runs."""

    model = "MB2"

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read temperatures and operation lines; a running program is recognised by a different active set point."""
        (lines,) = await self._registers.read(LINES, 1)
        process_value_c = await self._temperature(self._at.process_value)
        target_c = await self._temperature(self._at.set_point)
        in_force_c = await self._temperature(self._at.set_point_in_force)
        if lines & IDLE_LINE:
            return ControllerState(process_value_c, in_force_c, target_c, Control.IDLE, "it is idle")
        if abs(in_force_c - target_c) > ARRIVED_WITHIN_C:
            in_force_c = await self._followed(target_c)
        if abs(in_force_c - target_c) > ARRIVED_WITHIN_C:
            why = f"active set point {in_force_c:g} °C, manual set point {target_c:g} °C: a program may be running"
            return ControllerState(process_value_c, in_force_c, target_c, Control.FOREIGN, why)
        return ControllerState(process_value_c, in_force_c, target_c)

    async def command(self, temperature_c: float) -> None:
        """Write the set point and read it back."""
        await self._set(temperature_c)

    async def take_control(self) -> None:
        """End idling, or stop a program; InstrumentFault if the set point is not active then."""
        target_c = await self._temperature(self._at.set_point)
        (lines,) = await self._registers.read(LINES, 1)
        if lines & IDLE_LINE:
            await self._registers.set(LINES, (lines & ~IDLE_LINE,), "state of the operation lines", hexadecimal)
        elif abs(await self._temperature(self._at.set_point_in_force) - target_c) > ARRIVED_WITHIN_C:
            with suppress(NoAnswer, LinkLost):  # the active set point will show whether it was executed
                await self._link.write(PROGRAM_STOP, (1,))
        if abs(await self._followed(target_c) - target_c) > ARRIVED_WITHIN_C:
            raise InstrumentFault(
                self._link.device, "the chamber does not follow its set point", sent=f"set point {target_c:g} °C",
                remedy="Stop the program at the controller.",
            )  # fmt: skip

    async def _followed(self, target_c: float) -> float:
        """Active set point, which becomes the manual one after some time if nothing else controls."""
        return await read_back(
            lambda: self._temperature(self._at.set_point_in_force),
            lambda in_force_c: abs(in_force_c - target_c) <= ARRIVED_WITHIN_C,
        )


def _mode_name(mode: int) -> str:
    return Mode(mode).name.lower() if mode in list(Mode) else f"unknown ({mode:#x})"


class Binder(Chamber):
    """A ThermalChamber whose set point changes in steps."""

    def __init__(self, setup: Setup[BinderOptions, ChamberLimits, ChamberSafe]) -> None:
        made = Mb1 if setup.options.controller == "mb1" else Mb2
        super().__init__(setup.name, made(setup), setup.limits, setup.safe, setup.options)
