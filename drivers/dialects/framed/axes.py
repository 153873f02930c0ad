"""An axis with a frame protocol, as used by the logic of heads and rate tables."""

from __future__ import annotations

import asyncio
import math
from typing import Any

from drivers.description import Nothing, Setup
from drivers.dialects.framed.controller import FramedAxis
from drivers.dialects.framed.description import FramedHeadOptions, FramedTableOptions
from drivers.dialects.framed.status import Status
from drivers.errors import InstrumentFault, Refused
from drivers.kinds.head.axis import AxisState, OwnLimits
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head
from drivers.kinds.table.axis import Drive, Mode, State
from drivers.kinds.table.description import TableLimits
from drivers.kinds.table.driver import Table
from drivers.kinds.table.turns import LONGEST_LEG_DEG, TURN_DEG, TurnCounter
from drivers.transport.double_read import DoubleRead
from drivers.values import Reading

_MODES = {"off": Mode.OFF, "position": Mode.POSITION, "rate": Mode.RATE, "sine": Mode.SYNTHESIS}


class FramedHeadAxis(FramedAxis):
    """An Axis of a head; `acceleration_dps2` is sent with every move whose frame has a field for it."""

    limits: OwnLimits | None = None  # the controller does not report it

    def __init__(self, setup: Setup[FramedHeadOptions, Any, Any]) -> None:
        super().__init__(setup, setup.options)
        self.double_read = DoubleRead(setup.name, setup.note, checked=True)  # every frame has a checksum
        self._acceleration_dps2 = setup.options.acceleration

    async def angle(self) -> Reading:
        """Encoder angle (°)."""
        status = await self._status()
        return Reading(asyncio.get_running_loop().time(), status.angle_deg)

    async def state(self) -> AxisState:
        """Status bits."""
        status = await self._status()
        return AxisState(
            homed=status.homed, enabled=status.enabled, moving=status.moving, in_position=status.in_position,
            words=str(status),
        )  # fmt: skip

    async def check_faults(self) -> None:
        """Raise InstrumentFault with the names of the present faults, or if another master commands the axis."""
        status = await self._status()
        self._check_faults(status)
        if not status.remote:
            raise InstrumentFault(
                self._device, "the controller does not obey this line", received=str(status),
                remedy="Switch it to remote control.",
            )  # fmt: skip

    async def prepare(self, rate_dps: float) -> None:
        """Do nothing: the rate is sent with each move."""

    async def start_move(self, angle_deg: float, rate_dps: float, *, answer_s: float) -> None:
        """Start a move to an angle, sent once; return when the status after it was read. Raises Refused."""
        await self._send_command("move", angle=angle_deg, rate=rate_dps, acceleration=self._acceleration_dps2)

    async def abort(self) -> None:
        """Decelerate and hold."""
        await self._send_command("stop")

    def abort_at_once(self) -> None:
        """As `abort`, ahead of any queued message; raises LinkLost."""
        self.line.preempt("stop")


class FramedTableAxis(FramedAxis):
    """A TableAxis. If the status reports no mode, it is that of the last command; initially derived from the motion."""

    def __init__(self, setup: Setup[FramedTableOptions, TableLimits, Any]) -> None:
        super().__init__(setup, setup.options)
        self._wraps, self._endless = self.profile.angle_wraps, setup.limits.angle is None
        self.longest_leg_deg = LONGEST_LEG_DEG if self._wraps else math.inf
        self._turns = TurnCounter(setup.limits.angle)
        self._commanded_mode = Mode.OFF
        self._rate_dps, self._acceleration_dps2 = setup.options.rate, setup.options.acceleration
        self._here_deg, self._sine = 0.0, (0.0, 0.0)

    async def read_state(self) -> State:
        """State of the axis, its angle over whole turns."""
        return self._understood(await self._status())

    async def check_fault(self, state: State, sent: str = "") -> None:
        """Raise InstrumentFault with its reasons if the state has a fault, met by `sent`; clears nothing."""
        if state.drive is Drive.FAULT:
            raise self._fault(state.words, sent, str(state))

    async def make_ready(self) -> State:
        """Energise the motor, unless that is so already; return the state after it. Raises InstrumentFault, Refused."""
        status = await self._status()
        self._check_faults(status)
        if not status.homed:
            raise InstrumentFault(
                self._device, "the axis has not been homed, so its angles are undefined",
                received=str(status), remedy="Home it at the controller, where you can see it move.",
            )  # fmt: skip
        if not status.enabled:
            self._commanded_mode = Mode.OFF
            status = await self.enable()
        return self._understood(status)

    async def release_control(self) -> None:
        """Do nothing: the active interface is selected at the controller."""

    async def prepare(self, mode: Mode, rate_dps: float, acceleration_dps2: float) -> None:
        """Store parameters for the next command; the controller's own deceleration applies."""
        if mode is not Mode.OFF:
            self._rate_dps, self._acceleration_dps2 = rate_dps, acceleration_dps2

    async def demand_here(self, mode: Mode, angle_deg: float) -> None:
        """Store the angle from which POSITION starts."""
        self._here_deg = angle_deg

    async def demand_sine(self, amplitude_deg: float, frequency_hz: float, run_up_s: float) -> None:
        """Store the sine; its run-up is the controller's own. Raises Refused if the axis cannot oscillate."""
        if self.profile.commands.sine is None:
            raise Refused(
                self._device, "the controller cannot oscillate: its profile has no commands.sine",
                remedy="Remove the sine from the sequence, or use a table that can oscillate.",
            )  # fmt: skip
        self._sine = (amplitude_deg, frequency_hz)

    async def change_sine(self, amplitude_deg: float, frequency_hz: float, slew_hz_per_s: float) -> None:
        """Raise Refused: no framed controller is known that changes a running sine."""
        raise Refused(
            self._device, "the controller cannot sweep the frequency of a running sine",
            remedy="Use frequencies one after the other in the sequence, or a table that can sweep.",
        )  # fmt: skip

    async def enter(self, mode: Mode) -> None:
        """Go to the present angle, turn at rate zero, or oscillate: a mode is entered only by a command."""
        self._commanded_mode = mode
        if mode is Mode.SYNTHESIS:
            amplitude_deg, frequency_hz = self._sine
            await self._send_command("sine", amplitude=amplitude_deg, frequency=frequency_hz)
        elif mode is Mode.RATE:
            await self.turn(0.0)
        else:
            await self.go(self._here_deg)

    async def go(self, angle_deg: float) -> None:
        """Move the axis to an angle, within a turn if angles wrap."""
        within_deg = angle_deg % TURN_DEG if self._wraps and self._endless else angle_deg
        await self._send_command(
            "move", angle=within_deg, rate=self._rate_dps, acceleration=self._acceleration_dps2
        )  # fmt: skip

    async def turn(self, rate_dps: float) -> None:
        """Turn the axis at a rate."""
        await self._send_command("rate", rate=rate_dps, acceleration=self._acceleration_dps2)

    async def stop(self) -> None:
        """Decelerate and hold."""
        self._commanded_mode = Mode.OFF
        await self._send_command("stop")

    def stop_at_once(self) -> None:
        """As `stop`, ahead of all queued messages; raises LinkLost."""
        self._commanded_mode = Mode.OFF
        self.line.preempt("stop")

    def _understood(self, status: Status) -> State:
        mode = _MODES.get(status.mode, Mode.OTHER) if status.mode else self._commanded_mode
        if not status.mode and status.moving and mode is Mode.OFF:
            mode = Mode.OTHER
        drive = Drive.FAULT if status.faults else Drive.ON if status.enabled else Drive.OFF
        state = State(
            status.angle_deg, status.rate_dps or 0.0, drive, mode, held=not status.moving, oscillating=status.at_sine,
            in_control=status.remote, words=str(status),
        )  # fmt: skip
        return self._turns.count(asyncio.get_running_loop().time(), state) if self._wraps else state


class FramedHead(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[FramedHeadOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedHeadAxis(setup), setup.options, setup.limits)


class FramedTable(Table):
    """A Positioner and a RateTable."""

    def __init__(self, setup: Setup[FramedTableOptions, TableLimits, Nothing]) -> None:
        super().__init__(setup.name, FramedTableAxis(setup), setup.options, setup.limits)
