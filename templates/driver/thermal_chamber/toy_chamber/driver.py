"""The driver: queries and orders of this chamber; `drivers.kinds.chamber` decides when they are sent."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.description import Setup
from drivers.errors import Refused
from drivers.kinds.chamber.controller import Control, Look
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity

from toy_chamber import wire
from toy_chamber.description import ToyChamberOptions
from toy_chamber.wire import Mode, State

_CONTROL: Mapping[Mode, Control] = {
    Mode.ON: Control.SET_POINT, Mode.OFF: Control.NOBODY, Mode.PROGRAM: Control.OTHER,
}  # fmt: skip


class ToyChamberController:
    """A Controller with one set point and no ramp; a command may switch it on."""

    can_start = True

    def __init__(self, setup: Setup[ToyChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        self.limits_c: tuple[float, float] | None = None
        self._device = setup.name
        self._link = ScpiLink(setup)

    async def connect(self) -> None:
        """Connects anew, identifies, and asks how far set points go."""
        await self._link.open()
        self.limits_c = await self._link.ask(wire.LIMITS_QUERY, wire.read_limits)

    def close(self) -> None:
        """Closes the wire; the next exchange would open it again."""
        self._link.close()

    async def identify(self) -> Identity:
        """Who is there, by *IDN?."""
        return await self._link.identify()

    async def look(self, commanded_c: float | None) -> Look:
        """Air, set point and mode, in one answer."""
        state = await self._state(commanded_c)
        why = f"the chamber is in mode {state.mode.value}"
        return Look(state.air_c, state.set_point_c, state.set_point_c, _CONTROL[state.mode], why)

    async def command(self, temperature_c: float) -> None:
        """Sends the set point once and reads it back."""
        command, kept_c = wire.set_point(temperature_c), wire.kept(temperature_c)
        await self._link.write(command)
        state = await self._state(kept_c)
        if state.set_point_c != kept_c:
            raise Refused(
                self._device, "the controller did not take a new set point", sent=command,
                received=f"set point {state.set_point_c:g} °C",
                remedy="Look at the controller for a running program or protected settings.",
            )  # fmt: skip

    def kept(self, temperature_c: float) -> float:
        """To a tenth of a degree."""
        return wire.kept(temperature_c)

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Nothing: it has no ramp, and `drivers.kinds.chamber` gives it one set point after the other."""

    async def take_control(self) -> None:
        """Switches it on, which ends a program; Refused when it stays as it was."""
        command = wire.mode(Mode.ON)
        await self._link.write(command)
        state = await self._state(None)
        if state.mode is not Mode.ON:
            raise Refused(
                self._device, "the chamber does not follow its set point", sent=command,
                received=f"mode {state.mode.value}", remedy="Start it by hand at the chamber.",
            )  # fmt: skip

    async def _state(self, set_point_c: float | None) -> State:
        """Asked twice when the set point is another than it should be: the line has no checksum."""
        state = await self._link.ask(wire.STATE_QUERY, wire.read_state)
        if set_point_c in (None, state.set_point_c):
            return state
        return await self._link.ask(wire.STATE_QUERY, wire.read_state)


class ToyChamber(Chamber):
    """A ThermalChamber that is ramped by many set points."""

    def __init__(self, setup: Setup[ToyChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, ToyChamberController(setup), setup.limits, setup.safe, setup.options)
