"""A SIMPAC: queries and settings of a chamber."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from drivers.description import Setup
from drivers.dialects.simserv import wire
from drivers.dialects.simserv.description import SimservOptions
from drivers.dialects.simserv.wire import Function, Info, Status, message
from drivers.errors import InstrumentFault, NoAnswer, Refused, WrongIdentity
from drivers.kinds.chamber.controller import Control, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.lines import TextController, VerifiedLine
from drivers.kinds.chamber.ramp import OwnRamp
from drivers.kinds.chamber.refusal import Refusal
from drivers.kinds.chamber.tenths import as_stored
from drivers.timing.awake import now_s
from drivers.timing.readback import read_back
from drivers.transport.exchange import Pace, SyncQuery, lines_ending
from drivers.values import Identity

T = TypeVar("T")

MAX_MESSAGES = 40  # messages searched for the text of an error
_SERIAL_QUERY = message(Function.INFO, Info.SERIAL)
_GRADIENTS = (
    (Function.SET_GRADIENT_UP, Function.GRADIENT_UP), (Function.SET_GRADIENT_DOWN, Function.GRADIENT_DOWN),
)  # fmt: skip


class Simpac(TextController):
    """A Controller that ramps by itself, from its present set point.

    It reports only one set point. If that is the end of a ramp, the active set point is computed from gradient and
    time; if it is the active one, it is compared with the computed one.
    """

    def __init__(self, setup: Setup[SimservOptions, ChamberLimits, ChamberSafe]) -> None:
        self._reports_target = setup.options.set_point_reads == "target"
        self._serial = ""
        self._ramp: OwnRamp | None = None  # last commanded set point
        super().__init__(setup, VerifiedLine(
            setup, SyncQuery(_SERIAL_QUERY.encode("latin-1"), self._recognise), self._identify,
            Pace(answer_s=setup.options.answer_timeout), end=wire.END, framing=lines_ending(wire.ANSWER_END),
        ))  # fmt: skip

    async def read_state(self, commanded_c: float | None) -> ControllerState:
        """Read process value, set point and status."""
        process_value_c = await self._variable(Function.PROCESS_VALUE)
        reported_c = await self._variable(Function.SET_POINT)
        set_point_c, target_c = self._where(reported_c, commanded_c)
        control, why = await self._control()
        return ControllerState(process_value_c, set_point_c, target_c, control, why)

    async def command(self, temperature_c: float) -> None:
        """Send the set point and read it back.

        While a program runs it may be refused, or the program's set point is read back: then `take_control` sends it
        again.
        """
        target_c = as_stored(temperature_c)
        self._ramp = await self._ramp_to(target_c)
        try:
            await self._send(self._ramp)
        except Refused:
            if not await self._program_status():
                raise

    async def set_ramp(self, rate_c_per_min: float) -> None:
        """Set both gradients, each read back."""
        rate = wire.gradient(rate_c_per_min)
        for setting, reading in _GRADIENTS:
            command = message(setting, wire.TEMPERATURE, rate)
            await self._send_command(command)
            stored_c_per_min = await self._read_back(reading, lambda reported: wire.gradient(reported) == rate)
            if wire.gradient(stored_c_per_min) != rate:
                raise Refused(
                    self._device, "the controller did not take a new gradient", sent=command,
                    received=f"gradient {stored_c_per_min:g} °C/min",
                    remedy="Choose a ramp rate that the controller stores without rounding.",
                )  # fmt: skip

    async def take_control(self) -> None:
        """Stop a program, start the chamber, send the set point again; InstrumentFault during an error."""
        await self._check_errors()
        if await self._program_status():
            await self._send_command(message(Function.STOP_PROGRAM))
        start = message(Function.SWITCH, wire.START, 1)
        await self._send_command(start)
        await self._expect_started(self._control, start)
        if self._ramp is not None:
            self._ramp = self._ramp._replace(began_s=now_s())  # it was stopped until now
            await self.command(self._ramp.target_c)

    async def _send(self, ramp: OwnRamp) -> None:
        """Send the end of a ramp and read it back."""
        command = message(Function.SET_SET_POINT, wire.TEMPERATURE, wire.temperature(ramp.target_c))
        acknowledged = await self._send_command(command)
        reported_c = await self._read_back(
            Function.SET_POINT,
            lambda reported: reported == ramp.target_c or (acknowledged and self._may_be_on(ramp, reported)),
        )
        if reported_c == ramp.target_c:
            return
        if not self._may_be_on(ramp, reported_c):
            raise Refused(
                self._device, "the controller did not take a new set point", sent=command,
                received=f"set point {reported_c:g} °C",
                remedy="Look at the controller for a lock; options.set_point_reads in the bench file may be wrong.",
            )  # fmt: skip
        if not acknowledged:
            raise NoAnswer(self._device, "it is unknown whether a new set point was accepted", sent=command)

    def _may_be_on(self, ramp: OwnRamp, reported_c: float) -> bool:
        """Return whether a set point that is not the end of the ramp may be its present value."""
        return not self._reports_target and ramp.is_at(reported_c, now_s())

    async def _ramp_to(self, target_c: float) -> OwnRamp:
        """Ramp started by a new set point: from the active one, or from the air temperature if the chamber is off."""
        control, _ = await self._control()
        if control is Control.IDLE:
            start_c = await self._variable(Function.PROCESS_VALUE)
        else:
            start_c, _ = self._where(await self._variable(Function.SET_POINT), None)
        rate_c_per_min = await self._variable(Function.GRADIENT_UP if target_c > start_c else Function.GRADIENT_DOWN)
        return OwnRamp(start_c, target_c, rate_c_per_min / 60 or math.inf, now_s())  # gradient 0 means no ramp

    def _where(self, reported_c: float, commanded_c: float | None) -> tuple[float, float]:
        """Active set point and last commanded set point, °C."""
        ramp = self._ramp
        if ramp is None:
            return reported_c, reported_c
        if self._reports_target:
            return (ramp.set_point_c(now_s()) if reported_c == ramp.target_c else reported_c), reported_c
        on_its_way = commanded_c == ramp.target_c and ramp.is_at(reported_c, now_s())
        return reported_c, (ramp.target_c if on_its_way else reported_c)

    async def _control(self) -> tuple[Control, str]:
        status = await self._query(message(Function.STATUS), wire.status)
        if Status.ERROR in status:
            return Control.FOREIGN, f"the chamber has an error: {await self._error()}"
        if Status.RUNNING not in status:
            return Control.IDLE, "the chamber is off"
        if program := await self._program_status():
            return Control.FOREIGN, f"the chamber runs a program (status {program})"
        return Control.SET_POINT, ""

    async def _program_status(self) -> int:
        """Program number; 0 without a program."""
        return await self._query(message(Function.PROGRAM_STATUS), wire.whole)

    async def _check_errors(self) -> None:
        if Status.ERROR in await self._query(message(Function.STATUS), wire.status):
            raise InstrumentFault(
                self._device, "the chamber has an error", received=await self._error(),
                remedy="Remove the cause and acknowledge it at the chamber.",
            )  # fmt: skip

    async def _error(self) -> str:
        """Text of the first active error message."""
        count = await self._query(message(Function.MESSAGES), wire.whole)
        for index in range(1, min(count, MAX_MESSAGES) + 1):
            if await self._query(message(Function.MESSAGE_ACTIVE, index), wire.whole):
                return await self._query(message(Function.MESSAGE_TEXT, index), wire.text)
        return "no message text"

    async def _identify(self) -> None:
        kind = await self._query_once(message(Function.INFO, Info.TYPE), wire.text)
        unit = await self._query_once(message(Function.UNIT, wire.TEMPERATURE), wire.text)
        if not unit.endswith("C"):
            raise WrongIdentity(
                self._device, "the first control variable is not a temperature in °C", received=f"unit '{unit}'",
                remedy="Check that this is a thermal chamber, and its unit at the controller.",
            )  # fmt: skip
        low_c = await self._query_once(message(Function.LOWEST, wire.TEMPERATURE), wire.number)
        high_c = await self._query_once(message(Function.HIGHEST, wire.TEMPERATURE), wire.number)
        pin = self._pin
        found = Identity(
            maker=pin.maker or "Weiss Technik", model=kind, serial=self._serial, firmware=pin.firmware or ""
        )
        self._recognised.check(found, f"{kind}, serial number {self._serial}")
        self.limits_c = (low_c, high_c)

    def _recognise(self, line: bytes) -> None:
        serial = wire.unless_refused(wire.text)(line)
        if isinstance(serial, Refusal):
            raise ValueError(f"refused, {serial}")
        expected = (self._recognised.identity or self._pin).serial
        if expected not in (None, serial):
            raise WrongIdentity(
                self._device, f"the chamber's serial number is '{serial}', expected '{expected}'",
                remedy="Check that the right chamber is at this address, or correct the bench file.",
            )  # fmt: skip
        self._serial = serial

    async def _read_back(self, function: Function, agrees: Callable[[float], object]) -> float:
        """Value read back after a setting, once it agrees, or at the time limit."""
        return await read_back(lambda: self._variable(function), agrees)

    async def _variable(self, function: Function) -> float:
        return await self._query(message(function, wire.TEMPERATURE), wire.number)

    async def _query(self, question: str, read: Callable[[list[str]], T]) -> T:
        return await self._line.query(question, wire.unless_refused(read))

    async def _query_once(self, question: str, read: Callable[[list[str]], T]) -> T:
        return await self._line.query_once(question, wire.unless_refused(read))

    async def _send_command(self, command: str) -> bool:
        """Send a command once; return whether it was acknowledged."""
        return await self._line.send_command(command, wire.unless_refused(lambda _: True)) is not None


class Simserv(Chamber):
    """A ThermalChamber that ramps by itself."""

    def __init__(self, setup: Setup[SimservOptions, ChamberLimits, ChamberSafe]) -> None:
        super().__init__(setup.name, Simpac(setup), setup.limits, setup.safe, setup.options)
