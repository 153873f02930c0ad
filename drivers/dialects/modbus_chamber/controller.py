"""A controller described by a profile: registers read and written for a chamber."""

from __future__ import annotations

from typing import Any

from drivers.description import Setup
from drivers.dialects.modbus_chamber.description import ModbusChamberOptions
from drivers.dialects.modbus_chamber.profile import (
    ChamberProfile,
    CodeRegister,
    ModeRegister,
    Switch,
    ValueRegister,
    WrittenRegister,
)
from drivers.errors import CannotConnect, InstrumentFault, Refused, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberOptions, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.registers import RegisterController, spelled_by
from drivers.kinds.chamber.words import COLDEST_C, HOTTEST_C, Words
from drivers.recognised import as_stated
from drivers.values import Identity


class ProfiledController(RegisterController):
    """A Controller; what it reports depends on its profile.

    A set point is written only if the register holds another value, because writes wear out the memory of many
    controllers.
    """

    def __init__(self, setup: Setup[Any, ChamberLimits, ChamberSafe], profile: ChamberProfile) -> None:
        super().__init__(setup, gap_s=profile.gap)
        self.can_start = profile.mode is not None and profile.mode.start is not None
        self._profile = profile

    def _identity(self) -> Identity:
        """Names stated in the bench file and the profile; the fingerprint is reported by the wire."""
        low_c, high_c = self.limits_c or (0.0, 0.0)
        properties = [each.means for each in self._profile.must_be]
        if self._profile.limits is not None:
            properties.append(f"set point {low_c:g} to {high_c:g} °C")
        fingerprint = ", ".join(properties) or "a temperature where the process value is"
        return as_stated(self._pin, fingerprint, maker=self._profile.maker, model=self._profile.model)

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read alarms, mode and temperatures."""
        control, why = await self._control()
        target_c = in_force_c = await self._value(self._profile.set_point)
        if self._profile.set_point_in_force is not None:
            in_force_c = await self._value(self._profile.set_point_in_force)
        return ControllerState(await self._value(self._profile.process_value), in_force_c, target_c, control, why)

    async def command(self, temperature_c: float) -> None:
        """Write the set point, unless the register holds it already, and read it back."""
        register = self._profile.set_point
        words = self._profile.form(register).words(temperature_c)
        if await self._registers.read(register.address, register.count, function=register.read) != words:
            await self._set(register, temperature_c, "set point")

    def as_stored(self, temperature_c: float) -> float:
        """Set point as its register stores it; unchanged if the register cannot hold it."""
        form = self._profile.form(self._profile.set_point)
        try:
            return form.value(form.words(temperature_c))
        except OverflowError:
            return temperature_c

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Write the rate, then switch the ramp on."""
        ramp = self._profile.ramp
        if ramp is None:
            raise NotImplementedError
        await self._set(ramp.rate, rate_c_per_min * (60 if ramp.per == "hour" else 1), "ramp rate")
        if ramp.on is not None:
            await self._switch(ramp.on, ramp.on.value, "ramp switch")

    async def take_control(self) -> None:
        """Write the mode in which the set point controls; InstrumentFault if there is none, or during an alarm."""
        if alarm := await self._alarm():
            raise InstrumentFault(
                self._link.device, "the controller has an alarm", received=alarm,
                remedy="Find its cause, then acknowledge it at the controller.",
            )  # fmt: skip
        mode = self._profile.mode
        if mode is None or mode.start is None:
            raise InstrumentFault(
                self._link.device, "the chamber does not follow its set point", received=(await self._control())[1],
                remedy="Select its set-point mode at the controller, and find out who changed it.",
            )  # fmt: skip
        await self._switch(mode, mode.start, "mode")

    async def _control(self) -> tuple[Control, str]:
        """Current temperature control, with a message."""
        if alarm := await self._alarm():
            return Control.FOREIGN, alarm
        mode = self._profile.mode
        if mode is None:
            return Control.SET_POINT, ""
        found = await self._code(mode)
        if found in mode.follows:
            return Control.SET_POINT, ""
        if found in mode.off:
            return Control.IDLE, f"mode {found}, off"
        names = [name for name, number in mode.other.items() if number == found]
        return Control.FOREIGN, f"mode {found}, {names[0] if names else 'which is not in the profile'}"

    async def _alarm(self) -> str:
        """Text of active alarms; empty without an alarm."""
        found = [(each, await self._code(each)) for each in self._profile.alarms]
        return ", ".join(f"{each.means} ({code})" for each, code in found if code not in each.quiet)

    async def _code(self, register: CodeRegister) -> int:
        return (await self._registers.read(register.address, 1, function=register.read))[0]

    async def _value(self, register: ValueRegister) -> float:
        words = await self._registers.read(register.address, register.count, function=register.read)
        return self._number(register, words)

    async def _set(self, register: WrittenRegister, value: float, what: str) -> None:
        form = self._profile.form(register)
        try:
            words = form.words(value)
        except OverflowError as problem:
            raise Refused(
                self._link.device, f"no register can hold this {what}: {problem}; nothing was sent",
                remedy="Correct the sequence, or the scale in the profile if it is wrong.",
            ) from problem  # fmt: skip
        await self._registers.set(
            register.address, words, what, spelled_by(form.value), many=register.write == 16, function=register.read
        )

    async def _switch(self, register: ModeRegister | Switch, word: int, what: str) -> None:
        await self._registers.set(
            register.address, (word,), what, lambda words: str(words[0]), many=register.write == 16,
            function=register.read,
        )  # fmt: skip

    async def _identify(self) -> None:
        for each in self._profile.must_be:
            (found,) = await self._link.read(each.address, 1, function=each.read)
            if found != each.is_:
                raise self._other(f"a register has the wrong value: {each.means}", f"{found}, expected {each.is_}",
                                  f"read 1 register at {each.address}")  # fmt: skip
        limits_c = await self._read_limits()
        if self.limits_c not in (None, limits_c):
            raise self._other("another controller than before, or its set-point limits were changed",
                              f"set points from {limits_c[0]:g} to {limits_c[1]:g} °C")  # fmt: skip
        at = self._profile.process_value
        process_value_c = self._number(at, await self._link.read(at.address, at.count, function=at.read))
        if not COLDEST_C <= process_value_c <= HOTTEST_C:
            raise self._other("the process value is implausible", f"{process_value_c:g} °C")
        self.limits_c = limits_c

    async def _read_limits(self) -> tuple[float, float]:
        stated, limits = self._profile.range, self._profile.limits
        if limits is None:
            return (stated.min, stated.max) if stated is not None else (COLDEST_C, HOTTEST_C)
        low_c, high_c = [
            self._number(each, await self._link.read(each.address, each.count, function=each.read))
            for each in (limits.min, limits.max)
        ]
        if low_c < COLDEST_C or high_c > HOTTEST_C or low_c >= high_c:
            raise self._other("the set-point limits of the controller are implausible", f"{low_c:g} to {high_c:g} °C")
        return low_c, high_c

    def _number(self, register: ValueRegister, words: Words) -> float:
        return self._decode(words, self._profile.form(register).value, register.address)

    def _other(self, what: str, received: str, sent: str = "") -> WrongIdentity:
        return WrongIdentity(
            self._link.device, what, sent=sent, received=received,
            remedy="Check the address in the bench file and, for a new profile, its addresses, types and word order.",
        )  # fmt: skip


class ModbusChamber(Chamber):
    """A ThermalChamber that ramps by itself, or whose set point changes in steps, depending on its profile."""

    def __init__(self, setup: Setup[ModbusChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        options, profile = setup.options, setup.options.profile.content
        if profile is None:
            raise CannotConnect(
                setup.name, f"the profile {options.profile.path} of its controller is gone",
                remedy="Put the file back beside the bench file.",
            )  # fmt: skip
        ramp_options: ChamberOptions = options
        if profile.ramp is not None:
            ramp_options = ChamberOptions.model_construct(
                **{name: getattr(options, name) for name in ChamberOptions.model_fields}
            )
        super().__init__(setup.name, ProfiledController(setup, profile), setup.limits, setup.safe, ramp_options)
