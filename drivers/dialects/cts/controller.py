"""A CTS chamber: queries and settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from drivers.description import Setup
from drivers.dialects.cts import wire
from drivers.dialects.cts.description import CtsOptions
from drivers.dialects.cts.wire import Ramp, Status
from drivers.errors import BeyondLimit, InstrumentFault, NoAnswer, Refused
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.lines import TextController, VerifiedLine
from drivers.kinds.chamber.ramp import OwnRamp
from drivers.kinds.chamber.tenths import as_stored
from drivers.recognised import as_stated
from drivers.timing.awake import now_s
from drivers.timing.readback import read_back
from drivers.transport.exchange import Pace, SyncQuery, lines_ending

T = TypeVar("T")


class CtsController(TextController):
    """A Controller that ramps by itself, in tenths of a degree per minute, from its present set point.

    It reports no limits, and versions instead of names; unless the bench file pins those, any CTS chamber is accepted.
    A running program is recognised only by its set points.
    """

    def __init__(self, setup: Setup[CtsOptions, ChamberLimits, ChamberSafe]) -> None:
        self._options = setup.options
        self._address = address = setup.options.address
        sync_query = SyncQuery(wire.STATUS_QUERY.encode(), wire.of_address(address, wire.read_status))
        self._ramp: OwnRamp | None = None  # last commanded set point
        super().__init__(setup, VerifiedLine(
            setup, sync_query, self._identify, Pace(answer_s=setup.options.answer_timeout),
            framing=lines_ending(bytes([wire.ETX])), wrap=partial(wire.frame, address),
        ))  # fmt: skip

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read temperatures, end of the ramp, and state of the chamber."""
        process_value_c, set_point_c, ramp = await self._temperatures()
        control, why = await self._control()
        return ControllerState(process_value_c, set_point_c, ramp.target_c, control, why)

    async def command(self, temperature_c: float) -> None:
        """Send the set point and read it back."""
        target_c = as_stored(temperature_c)
        process_value_c, set_point_c, ramp = await self._temperatures()
        control, _ = await self._control()
        start_c = process_value_c if control is Control.IDLE else set_point_c
        rate_c_per_min = (ramp.up_c_per_min if target_c > start_c else ramp.down_c_per_min) if ramp.active else math.inf
        command = wire.set_point(target_c)
        self._ramp = OwnRamp(start_c, target_c, rate_c_per_min / 60, now_s())
        await self._send_command(command)
        stored_c = (await read_back(self._temperatures, lambda reported: reported[2].target_c == target_c))[2].target_c
        if stored_c != target_c:
            raise Refused(
                self._device, "the chamber did not take a new set point", sent=command,
                received=f"set point {stored_c:g} °C", remedy="Look at the chamber for a lock or a running program.",
            )  # fmt: skip

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Set both rates and read them back; BeyondLimit unless a multiple of 0.1 °C/min."""
        if not wire.can_be_set(rate_c_per_min):
            raise BeyondLimit(
                self._device, f"the chamber has no rate of {rate_c_per_min:g} °C/min; nothing was sent",
                remedy="Choose a rate in steps of 0.1 °C/min, which is 6 °C/h.",
            )  # fmt: skip
        commands = wire.ramp_rates(self._options.ramp_channel, rate_c_per_min)
        for command in commands:
            await self._send_command(command)
        rates = {round(rate_c_per_min, 1)}

        def agrees(ramp: Ramp) -> bool:
            return ramp.active and {ramp.up_c_per_min, ramp.down_c_per_min} == rates

        ramp = await read_back(self._query_ramp, agrees)
        if not agrees(ramp):
            raise Refused(
                self._device, "the chamber did not take a new rate", sent=" and ".join(commands),
                received=f"rates {ramp.up_c_per_min:g} and {ramp.down_c_per_min:g} °C/min",
                remedy="Look at the chamber for a lock; options.ramp_channel in the bench file may be wrong.",
            )  # fmt: skip

    async def take_control(self) -> None:
        """End a pause, start the chamber, send the set point again; InstrumentFault while there is an error."""
        status = await self._query(wire.STATUS_QUERY, wire.read_status)
        if status.error:
            raise InstrumentFault(
                self._device, "the chamber has an error", received=f"number '{status.error}'",
                remedy="Remove the cause and acknowledge it at the chamber.",
            )  # fmt: skip
        start = wire.RESUME if status.running else wire.START
        await self._send_command(start)
        await self._expect_started(self._control, start)
        if self._ramp is not None:
            self._ramp = self._ramp._replace(began_s=now_s())  # it was paused until now
            await self.command(self._ramp.target_c)

    async def _control(self) -> tuple[Control, str]:
        return _control(await self._query(wire.STATUS_QUERY, wire.read_status))

    async def _temperatures(self) -> tuple[float, float, Ramp]:
        """Process value and active set point, °C, and the ramp.

        During a ramp some chambers report the present value of the ramp as set point, others possibly its end: then the
        present value is computed from rate and time.
        """
        temperatures = await self._query(wire.TEMPERATURE_QUERY, wire.read_temperatures)
        ramp = await self._query_ramp()
        reported_c = temperatures.set_point_c
        if not ramp.active:
            return temperatures.process_value_c, reported_c, Ramp(False, math.inf, math.inf, reported_c)
        own = self._ramp
        by_the_clock = own is not None and reported_c == ramp.target_c == own.target_c
        set_point_c = own.set_point_c(now_s()) if own is not None and by_the_clock else reported_c
        return temperatures.process_value_c, set_point_c, ramp

    async def _identify(self) -> None:
        versions = await self._query_versions() if self._options.versions else ""
        fingerprint = f"versions {versions}" if versions else f"answers at address {self._address}"
        found = as_stated(self._pin, fingerprint, maker="CTS", model="", firmware=versions)
        self._recognised.check(found, found.fingerprint)
        self.limits_c = (wire.COLDEST_C, wire.HOTTEST_C)

    async def _query_versions(self) -> str:
        try:
            return await self._line.query_once(wire.VERSIONS_QUERY, wire.of_address(self._address, wire.read_versions))
        except NoAnswer as silent:
            raise NoAnswer(
                self._device, "the chamber does not report its versions", sent=wire.VERSIONS_QUERY,
                remedy="If it never does, set options.versions to false in the bench file.",
            ) from silent  # fmt: skip

    async def _query_ramp(self) -> Ramp:
        return await self._query(f"R{self._options.ramp_channel}", wire.read_ramp)

    async def _query(self, question: str, read: Callable[[str], T]) -> T:
        return await self._line.query(question, wire.of_address(self._address, read))

    async def _send_command(self, command: str) -> None:
        await self._line.send_command(command, wire.of_address(self._address, wire.read_done(command)))


def _control(status: Status) -> tuple[Control, str]:
    if status.error:
        return Control.FOREIGN, f"the chamber has an error, number '{status.error}'"
    if not status.running:
        return Control.IDLE, "the chamber is off"
    return (Control.FOREIGN, "the chamber is paused") if status.paused else (Control.SET_POINT, "")


class Cts(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[CtsOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, CtsController(setup), setup.limits, setup.safe, setup.options)
