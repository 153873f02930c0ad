"""Channel 1 of an F4: registers read and written for a chamber."""

from __future__ import annotations

import asyncio
import math
from contextlib import suppress

from drivers.description import IdentityPin, Setup, check_identity
from drivers.dialects.watlow_f4.description import F4Options
from drivers.dialects.watlow_f4.wire import (
    INPUT_ERRORS,
    MAX_DECIMALS,
    MEASURED_COUNT,
    MEASURED_FIRST,
    MODEL_F4,
    DisplayUnit,
    Register,
    Status,
    TemperatureFormat,
    event_output,
)
from drivers.errors import InstrumentFault, LinkLost, NoAnswer, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.registers import RegisterController, hexadecimal, spelled_by
from drivers.kinds.chamber.words import Words
from drivers.recognised import as_stated
from drivers.timing.readback import read_back
from drivers.values import Identity

TERMINATING_S = 0.5  # pause that the controller needs after the end of a profile
_PROFILE = {Status.PROFILE_RUNS: "a profile runs", Status.PROFILE_ON_HOLD: "a profile is on hold"}


class F4Channel(RegisterController):
    """A Controller ramped by a series of set points.

    Every accepted set point is stored in a memory that wears out, so one that is set already is not sent.
    """

    can_start = True

    def __init__(self, setup: Setup[F4Options, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup)
        power_event = setup.options.power_event
        self._power = event_output(power_event) if power_event is not None else None
        self._power_name = f"event output {power_event}"
        self._form = TemperatureFormat()
        self._known: tuple[Words, Words, int] | None = None  # of the controller at the first connection
        self._commanded_c = math.nan

    def _identity(self) -> Identity:
        """Names stated in the bench file; the fingerprint is reported by the controller."""
        names, _, decimals = self._known or ((0,) * 5, (), 0)
        low_c, high_c = self.limits_c or (0.0, 0.0)
        return as_stated(
            self._pin, f"serial number registers {names[1]} {names[2]}, °C with {decimals} decimals, "
            f"set point {low_c:g} to {high_c:g} °C",
            maker="Watlow", model="F4", firmware=_firmware(names),
        )  # fmt: skip

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read process value, status and set points; InstrumentFault if the controller reports a sensor fault."""
        found = self._form.measured(await self._registers.read(MEASURED_FIRST, MEASURED_COUNT))
        if found.input_error:
            raise InstrumentFault(
                self._link.device, "the controller has no process value",
                received=f"input error {found.input_error}, {INPUT_ERRORS.get(found.input_error, 'unknown')}",
                remedy="Check the chamber's sensor and its cable.",
            )  # fmt: skip
        (status,) = await self._registers.read(Register.STATUS, 1)
        target_c = in_force_c = await self._temperature(Register.SET_POINT)
        if status in _PROFILE:
            in_force_c = await self._temperature(Register.PROFILE_SET_POINT)
        control, why = await self._control(found.alarm, status, target_c)
        return ControllerState(found.process_value_c, in_force_c, target_c, control, why)

    async def command(self, temperature_c: float) -> None:
        """Write the set point, unless it is set already, and read it back."""
        word = self._form.word(temperature_c)
        self._commanded_c = temperature_c
        if await self._registers.read(Register.SET_POINT, 1) != (word,):
            spelled = spelled_by(lambda words: self._form.value_c(words[0]), " °C")
            await self._registers.set(Register.SET_POINT, (word,), "set point", spelled)

    def as_stored(self, temperature_c: float) -> float:
        """Set point rounded to the decimals of the controller; unchanged if no register can hold it."""
        try:
            return self._form.value_c(self._form.word(temperature_c))
        except OverflowError:
            return temperature_c

    async def take_control(self) -> None:
        """End a profile and switch the chamber on; InstrumentFault during an alarm."""
        found = self._form.measured(await self._registers.read(MEASURED_FIRST, MEASURED_COUNT))
        if found.alarm:
            raise InstrumentFault(
                self._link.device, "the controller has an alarm", received=found.alarm,
                remedy="Find its cause, then clear it at the controller.",
            )  # fmt: skip
        (status,) = await self._registers.read(Register.STATUS, 1)
        if status in _PROFILE:
            await self._end_profile()
            await self.command(self._commanded_c)  # a profile may leave another set point
        if self._power is not None and await self._registers.read(self._power, 1) != (1,):
            await self._registers.set(self._power, (1,), self._power_name, hexadecimal)

    async def _end_profile(self) -> None:
        """Terminate the profile once; the status shows whether it ended."""
        with suppress(NoAnswer, LinkLost):
            await self._link.write(Register.TERMINATE, (1,))
        await asyncio.sleep(TERMINATING_S)
        (status,) = await read_back(
            lambda: self._registers.read(Register.STATUS, 1), lambda words: words[0] not in _PROFILE
        )
        if status in _PROFILE:
            raise InstrumentFault(
                self._link.device, "the profile did not end", sent="terminate the profile",
                received=f"status {status}, {_PROFILE[Status(status)]}",
                remedy="Terminate the profile at the controller.",
            )  # fmt: skip

    async def _control(self, alarm: str, status: int, target_c: float) -> tuple[Control, str]:
        """Current temperature control, with a message."""
        if alarm:
            return Control.FOREIGN, alarm
        if status in _PROFILE:
            return Control.FOREIGN, _PROFILE[Status(status)]
        if self.limits_c is not None and target_c < self.limits_c[0]:
            return Control.IDLE, "the set point is off"
        if self._power is not None and await self._registers.read(self._power, 1) != (1,):
            return Control.IDLE, f"{self._power_name} is off"
        return Control.SET_POINT, ""

    async def _temperature(self, register: Register) -> float:
        return self._form.value_c((await self._registers.read(register, 1))[0])

    async def _identify(self) -> None:
        names = await self._link.read(Register.MODEL, 5)
        if names[0] != MODEL_F4:
            raise self._other(
                "this is no Watlow F4", f"model code {names[0]}, expected {MODEL_F4}",
                "Check the driver and the address in the bench file.",
            )  # fmt: skip
        (unit,) = await self._link.read(Register.DISPLAY_UNIT, 1)
        if unit != DisplayUnit.CELSIUS:
            raise self._other(
                "the display unit of the controller is not °C",
                "0, which is °F" if unit == DisplayUnit.FAHRENHEIT else f"{unit}, expected 1",
                "Set the display unit to °C at the controller.",
            )  # fmt: skip
        (decimals,) = await self._link.read(Register.DECIMALS, 1)
        limits = await self._link.read(Register.SET_POINT_MIN, 2)
        form = TemperatureFormat(min(decimals, MAX_DECIMALS))
        low_c, high_c = form.value_c(limits[0]), form.value_c(limits[1])
        if decimals > MAX_DECIMALS or low_c >= high_c:
            raise self._other(
                "the settings of the controller are implausible",
                f"{decimals} decimals, set point limits {hexadecimal(limits)}",
                "Check the address in the bench file, and the set-point limits at the controller.",
            )  # fmt: skip
        if self._known not in (None, (names, limits, decimals)):
            raise self._other(
                "another controller than before, or its settings were changed",
                f"set points from {low_c:g} to {high_c:g} °C, {decimals} decimals, serial {names[1]} {names[2]}",
                "Check the address in the bench file, then start again.",
            )  # fmt: skip
        pin = IdentityPin(firmware=self._pin.firmware)
        check_identity(self._link.device, pin, Identity(firmware=_firmware(names)))
        self._known, self._form, self.limits_c = (names, limits, decimals), form, (low_c, high_c)

    def _other(self, what: str, received: str, remedy: str) -> WrongIdentity:
        return WrongIdentity(self._link.device, what, received=received, remedy=remedy)


def _firmware(names: Words) -> str:
    """Software and revision, from the five words that identify a controller."""
    return f"{names[3]} revision {names[4] / 100:.2f}"


class WatlowF4(Chamber):
    """A ThermalChamber whose set point changes in steps."""

    def __init__(self, setup: Setup[F4Options, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, F4Channel(setup), setup.limits, setup.safe, setup.options)
