"""The driver: queries and commands of this chamber; `drivers.kinds.chamber` decides when they are sent."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.description import Setup
from drivers.errors import Refused
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity

from toy_chamber import wire
from toy_chamber.description import ToyChamberOptions
from toy_chamber.wire import Mode, State

_CONTROL: Mapping[Mode, Control] = {
    Mode.ON: Control.SET_POINT, Mode.OFF: Control.IDLE, Mode.PROGRAM: Control.FOREIGN,
}  # fmt: skip


class ToyChamberController:
    """A Controller with one set point and no ramp; a command may switch it on."""

    can_start = True

    def __init__(self, setup: Setup[ToyChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        self.limits_c: tuple[float, float] | None = None
        self._device = setup.name
        self._link = ScpiLink(setup)

    async def connect(self) -> None:
        """Reconnect, identify, and query the limits of the set point."""
        await self._link.open()
        self.limits_c = await self._link.query(wire.LIMITS_QUERY, wire.read_limits)

    def close(self) -> None:
        """Close the connection; the next exchange would reopen it."""
        self._link.close()

    async def identify(self) -> Identity:
        """Query the identity by *IDN?."""
        return await self._link.identify()

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read air, set point and mode in one answer."""
        state = await self._state(commanded_c)
        why = f"the chamber is in mode {state.mode.value}"
        return ControllerState(state.air_c, state.set_point_c, state.set_point_c, _CONTROL[state.mode], why)

    async def command(self, temperature_c: float) -> None:
        """Send the set point once and read it back."""
        command, stored_c = wire.set_point(temperature_c), wire.as_stored(temperature_c)
        await self._link.write(command)
        state = await self._state(stored_c)
        if state.set_point_c != stored_c:
            raise Refused(
                self._device, "the controller did not take a new set point", sent=command,
                received=f"set point {state.set_point_c:g} °C",
                remedy="Look at the controller for a running program or protected settings.",
            )  # fmt: skip

    def as_stored(self, temperature_c: float) -> float:
        """Set point as stored: rounded to a tenth of a degree."""
        return wire.as_stored(temperature_c)

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Do nothing: it has no ramp; `drivers.kinds.chamber` sends a series of set points."""

    async def take_control(self) -> None:
        """Switch the chamber on, which ends a program; Refused if its state does not change."""
        command = wire.mode(Mode.ON)
        await self._link.write(command)
        state = await self._state(None)
        if state.mode is not Mode.ON:
            raise Refused(
                self._device, "the chamber does not follow its set point", sent=command,
                received=f"mode {state.mode.value}", remedy="Start it by hand at the chamber.",
            )  # fmt: skip

    async def _state(self, set_point_c: float | None) -> State:
        """Query the state, twice if the set point is unexpected, because the line has no checksum."""
        state = await self._link.query(wire.STATE_QUERY, wire.read_state)
        if set_point_c in (None, state.set_point_c):
            return state
        return await self._link.query(wire.STATE_QUERY, wire.read_state)


class ToyChamber(Chamber):
    """A ThermalChamber ramped by a series of set points."""

    def __init__(self, setup: Setup[ToyChamberOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, ToyChamberController(setup), setup.limits, setup.safe, setup.options)
