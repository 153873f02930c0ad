"""A P300: queries and settings of a chamber."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeVar

from drivers.description import Setup
from drivers.dialects.espec_p300 import wire
from drivers.dialects.espec_p300.description import P300Options
from drivers.dialects.espec_p300.wire import Monitor, Temperatures
from drivers.errors import BadAnswer, InstrumentFault, Refused, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.lines import TextController, VerifiedLine
from drivers.kinds.chamber.tenths import as_stored
from drivers.recognised import as_stated
from drivers.timing.readback import read_back
from drivers.transport.exchange import Pace, SyncQuery

T = TypeVar("T")

SAME_WITHIN_C = 1.0  # possible change of the air temperature in the second between two queries
QUERY_GAP_S, SETTING_GAP_S = 0.3, 1.0  # pauses of third-party drivers after a query and after a setting
_CONTROL: Mapping[str, Control] = {
    wire.CONSTANT: Control.SET_POINT, wire.OFF: Control.IDLE, wire.STANDBY: Control.IDLE,
}  # fmt: skip


class P300(TextController):
    """A Controller with one set point and no ramp.

    It reports its kind and firmware version, but no serial number.
    """

    def __init__(self, setup: Setup[P300Options, ChamberLimits, ChamberSafe]) -> None:
        self._address = setup.options.address
        self._commanded_c = math.nan
        self._kind = ""  # answer to TYPE?
        sync_query = SyncQuery(self._addressed(wire.TYPE_QUERY).encode(), self._recognise)
        pace = Pace(answer_s=setup.options.answer_timeout, gap_s=QUERY_GAP_S)
        super().__init__(
            setup,
            VerifiedLine(setup, sync_query, self._identify, pace, end=wire.END, order_gap_s=SETTING_GAP_S),
        )

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read temperatures, then the state of the chamber.

        BadAnswer if the two answers disagree about the process value.
        """
        temperatures = await self._temperatures()
        monitor = await self._monitor()
        set_point_c = temperatures.set_point_c
        if abs(temperatures.process_value_c - monitor.process_value_c) > SAME_WITHIN_C:
            raise BadAnswer(
                self._device, "the process value was reported twice, with different values",
                sent=f"{wire.TEMPERATURE_QUERY} and {wire.MONITOR_QUERY}",
                received=f"{temperatures.process_value_c:g} and {monitor.process_value_c:g} °C",
                remedy="Check the serial line: its cable, its shield, its baud rate.",
            )  # fmt: skip
        control = Control.FOREIGN if monitor.alarms else _CONTROL.get(monitor.mode, Control.FOREIGN)
        return ControllerState(
            temperatures.process_value_c, set_point_c, set_point_c, control, await self._state_text(monitor)
        )

    async def command(self, temperature_c: float) -> None:
        """Send the set point and read it back.

        While a program runs it may be refused, or the program's set point is read back: then `take_control` sends it
        again.
        """
        self._commanded_c = temperature_c
        command = wire.set_point(temperature_c)
        try:
            await self._send_command(command)
            stored_c = as_stored(temperature_c)
            reported = await read_back(self._temperatures, lambda reported: reported.set_point_c == stored_c)
            if (set_point_c := reported.set_point_c) != stored_c:
                raise Refused(
                    self._device, "the controller did not take a new set point", sent=command,
                    received=f"set point {set_point_c:g} °C",
                    remedy="Look at the controller for a running program or protected settings.",
                )  # fmt: skip
        except Refused:
            if (await self._monitor()).mode in _CONTROL:
                raise

    async def take_control(self) -> None:
        """Switch on constant operation, which ends a program, and send the set point again.

        InstrumentFault while there is an alarm.
        """
        monitor = await self._monitor()
        if monitor.alarms:
            raise InstrumentFault(
                self._device, "the chamber has an alarm", received=await self._state_text(monitor),
                remedy="Remove the cause and acknowledge it at the chamber.",
            )  # fmt: skip
        if monitor.mode == wire.OFF:
            await self._send_command(wire.POWER_ON)
            await read_back(self._monitor, lambda reported: reported.mode != wire.OFF)
        await self._send_command(wire.CONSTANT_MODE)
        monitor = await read_back(self._monitor, lambda reported: reported.mode == wire.CONSTANT)
        if monitor.mode != wire.CONSTANT:
            raise Refused(
                self._device, "the chamber did not go to constant operation", sent=wire.CONSTANT_MODE,
                received=await self._state_text(monitor), remedy="Start it by hand at the chamber.",
            )  # fmt: skip
        await self.command(self._commanded_c)

    async def _identify(self) -> None:
        rom = await self._query_once(wire.ROM_QUERY, wire.read_rom)
        limits = await self._query_once(wire.TEMPERATURE_QUERY, wire.read_temperatures)
        fingerprint = f"controller {self._kind}, programs {rom}"
        stated = as_stated(self._pin, fingerprint, maker="ESPEC", model=self._kind, firmware=rom)
        found = stated._replace(model=self._kind)  # reported by the wire
        self._recognised.check(found, found.fingerprint)
        self.limits_c = (limits.lowest_c, limits.highest_c)

    def _recognise(self, line: bytes) -> None:
        kind = wire.read_type(line.decode("ascii"))
        expected = (self._recognised.identity or self._pin).model
        if expected not in (None, kind):
            raise WrongIdentity(
                self._device, f"the controller is of kind '{kind}', expected '{expected}'", sent=wire.TYPE_QUERY,
                received=line.decode("ascii"),
                remedy="Check that the right chamber is at this address, or correct the bench file.",
            )  # fmt: skip
        self._kind = kind

    async def _temperatures(self) -> Temperatures:
        return await self._line.double_read.confirmed("its temperature", self._query_temperatures, agree=wire.agree)

    async def _query_temperatures(self) -> Temperatures:
        return await self._query(wire.TEMPERATURE_QUERY, wire.read_temperatures)

    async def _monitor(self) -> Monitor:
        return await self._query(wire.MONITOR_QUERY, wire.read_monitor)

    async def _state_text(self, monitor: Monitor) -> str:
        if not monitor.alarms:
            return f"the chamber is in mode {monitor.mode}"
        codes = await self._query(wire.ALARM_QUERY, wire.read_alarms)
        return f"the chamber is in mode {monitor.mode}, alarm {', '.join(map(str, codes))}"

    async def _query(self, question: str, read: Callable[[str], T]) -> T:
        return await self._line.query(self._addressed(question), wire.unless_refused(read))

    async def _query_once(self, question: str, read: Callable[[str], T]) -> T:
        return await self._line.query_once(self._addressed(question), wire.unless_refused(read))

    async def _send_command(self, command: str) -> None:
        await self._line.send_command(self._addressed(command), wire.unless_refused(wire.read_done))

    def _addressed(self, command: str) -> str:
        return wire.addressed(command, self._address)


class EspecP300(Chamber):
    """A ThermalChamber ramped by a series of set points."""

    def __init__(self, setup: Setup[P300Options, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, P300(setup), setup.limits, setup.safe, setup.options)
