"""Queries and commands for one axis of an Acutrol3000: state, motion, interlock and lock-outs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, TypeVar

from drivers.description import Nothing, Setup
from drivers.dialects.acutronic_acl import wire
from drivers.dialects.acutronic_acl.description import AclOptions
from drivers.dialects.acutronic_acl.wire import Dynamics, Interlock, Reply
from drivers.errors import InstrumentFault, Refused
from drivers.kinds.table.axis import Drive, Mode, State
from drivers.kinds.table.description import TableLimits
from drivers.kinds.table.driver import Table
from drivers.kinds.table.turns import LONGEST_LEG_DEG, TURN_DEG, TurnCounter
from drivers.recognised import Recognised
from drivers.timing.readback import read_back
from drivers.transport.dialogue import Dialogue, OverDialogue
from drivers.transport.exchange import Pace, SyncQuery
from drivers.values import Identity

T = TypeVar("T")

ANSWER_S = 1.0  # 2 ms as a rule
INTERLOCK_STEP_S = 0.25  # pause between two steps in start-up scripts of third parties
OSCILLATING = Dynamics.AT_AMPLITUDE | Dynamics.AT_FREQUENCY
_DRIVES = {Interlock.CLOSED: Drive.ON, Interlock.OPEN: Drive.OFF, Interlock.FAULT: Drive.FAULT}
_INTERLOCKS = {drive: interlock.value for interlock, drive in _DRIVES.items()}
_MODES = {
    wire.Mode.OFF: Mode.OFF, wire.Mode.POSITION: Mode.POSITION, wire.Mode.RATE: Mode.RATE,
    wire.Mode.SYNTHESIS: Mode.SYNTHESIS,
}  # fmt: skip
_OWN_MODES = {mode: own for own, mode in _MODES.items()}


class AclAxis(OverDialogue):
    """One axis of a controller; a TableAxis.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost. Concurrency: callers queue for the line.
    """

    longest_leg_deg = LONGEST_LEG_DEG

    def __init__(self, setup: Setup[AclOptions, TableLimits, Any]) -> None:
        self._device, self._pin = setup.name, setup.identity
        self._number, self._byte_order = setup.options.axis, setup.options.byte_order
        self._turns, self._endless = TurnCounter(setup.limits.angle), setup.limits.angle is None
        self._recognised = Recognised(setup.name, setup.identity)
        self._locked_out = False
        framing = partial(wire.whole_answer, order=self._byte_order)
        sync_query = SyncQuery(wire.IDENTITY_QUERY.encode(), self._recognise)
        self._dialogue = Dialogue(setup, sync_query, framing=framing, pace=Pace(ANSWER_S))

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""
        return await self._dialogue.query(wire.IDENTITY_QUERY.encode(), self._recognise)

    async def read_state(self) -> State:
        """State of the axis, its angle over whole turns."""
        state = await self._query(wire.STATE_QUERY.format(self._number), _read_state)
        return self._turns.count(asyncio.get_running_loop().time(), state)

    async def check_fault(self, state: State, sent: str = "") -> None:
        """Raise InstrumentFault with its reasons if the interlock has a fault; `sent` is the command that met it."""
        if state.drive is not Drive.FAULT:
            return
        reasons = await self._query(wire.FAULTS_QUERY.format(self._number), wire.read_faults)
        raise InstrumentFault(
            self._device, f"axis {self._number} has an interlock fault: {reasons or 'no reason reported'}", sent=sent,
            remedy="Remove the cause, reset the interlock at the controller (INTERLOCK:RESET), then run again.",
        )  # fmt: skip

    async def make_ready(self) -> State:
        """Take control and energise the drive, unless that is so already; return the state after it.

        Raises InstrumentFault when a fault is latched: a person at the controller has to reset it; Refused when the
        drive stays off.
        """
        state = await self.read_state()
        await self.check_fault(state)
        self._locked_out = True
        if not state.in_control:
            await self._set(*wire.lock_out(True))
        if state.drive is not Drive.ON:
            for command in (wire.enter(wire.Mode.OFF, self._number), wire.ENERGISE.format(self._number)):
                await self._send_command(command)
                await asyncio.sleep(INTERLOCK_STEP_S)
        state = await read_back(self.read_state, lambda state: state.drive is not Drive.OFF and state.in_control)
        await self.check_fault(state)
        if state.drive is not Drive.ON:
            raise Refused(
                self._device, f"the drive of axis {self._number} stays off", sent=wire.ENERGISE.format(self._number),
                received=f"interlock {_INTERLOCKS[state.drive]}",
                remedy="Check the emergency stop, the doors and the amplifier, then run again.",
            )  # fmt: skip
        return state

    async def release_control(self) -> None:
        """Unlock the front panel and other interfaces, if this session used the table."""
        if self._locked_out:
            self._locked_out = False
            await self._set(*wire.lock_out(False))

    async def prepare(self, mode: Mode, rate_dps: float, acceleration_dps2: float) -> None:
        """Set the motion limits of a mode."""
        await self._set(*wire.limit(_OWN_MODES[mode], self._number, rate_dps, acceleration_dps2))

    async def demand_here(self, mode: Mode, angle_deg: float) -> None:
        """Set the last demand of a mode to the present angle, or to rate zero."""
        at_rest = wire.demand_rate(self._number, 0.0)
        await self._set(at_rest if mode is Mode.RATE else self._demand_position(angle_deg))

    async def demand_sine(self, amplitude_deg: float, frequency_hz: float, run_up_s: float) -> None:
        """Set the sine of SYNTHESIS."""
        await self._set(
            wire.configure_sine(self._number, amplitude_deg / run_up_s, frequency_hz / run_up_s),
            wire.demand_sine(self._number, amplitude_deg, frequency_hz),
        )

    async def change_sine(self, amplitude_deg: float, frequency_hz: float, slew_hz_per_s: float) -> None:
        """Change the frequency of the running sine at a constant rate, sent once."""
        await self._set(wire.configure_sine(self._number, amplitude_deg, slew_hz_per_s))
        await self._send_command(wire.demand_sine(self._number, amplitude_deg, frequency_hz))

    async def enter(self, mode: Mode) -> None:
        """Make the servo follow the demand of a mode."""
        await self._send_command(wire.enter(_OWN_MODES[mode], self._number))

    async def go(self, angle_deg: float) -> None:
        """Demand an angle, within a turn of an axis without ends."""
        await self._send_command(self._demand_position(angle_deg))

    async def turn(self, rate_dps: float) -> None:
        """Demand a rate."""
        await self._send_command(wire.demand_rate(self._number, rate_dps))

    async def stop(self) -> None:
        """Make the servo hold rate zero."""
        await self._send_command(wire.enter(wire.Mode.OFF, self._number))

    def stop_at_once(self) -> None:
        """Hold rate zero, ahead of any queued message; raises LinkLost."""
        self._dialogue.line.preempt(wire.enter(wire.Mode.OFF, self._number).encode())

    def _demand_position(self, angle_deg: float) -> str:
        return wire.demand_position(self._number, round(angle_deg, 6) % TURN_DEG if self._endless else angle_deg)

    async def _set(self, *commands: str) -> None:
        """Send a setting that moves nothing; raises Refused, or NoAnswer if its effect is unknown."""
        for command in commands:
            await self._accepted(command, await self._dialogue.query_once(command.encode(), self._read_reply))

    async def _send_command(self, command: str) -> None:
        """Send, once, a command that moves or energises; raises InstrumentFault or Refused if the answer is an error.

        Also returns if the answer is missing or garbled: the caller decides by reading back.
        """
        reply = await self._dialogue.send_command(command.encode(), self._read_reply)
        if reply is not None:
            await self._accepted(command, reply)

    async def _query(self, question: str, read: Callable[[str], T]) -> T:
        """Query and decode with `read`; raises Refused if the answer is an error."""

        def read_text(answer: bytes) -> T | Reply:
            reply = self._read_reply(answer)
            return read(reply.text) if reply.code == wire.NO_ERROR else reply

        found = await self._dialogue.query(question.encode(), read_text)
        if isinstance(found, Reply):
            raise self._refusal(question, found)
        return found

    def _read_reply(self, answer: bytes) -> Reply:
        return wire.read_reply(answer, self._byte_order)

    async def _accepted(self, command: str, reply: Reply) -> None:
        if reply.code != wire.NO_ERROR:
            await self.check_fault(await self.read_state(), command)
            raise self._refusal(command, reply)

    def _refusal(self, sent: str, reply: Reply) -> Refused:
        return Refused(
            self._device, "the controller refused a command", sent=sent, received=str(reply),
            remedy="Look at the controller's error queue, and check the axis and the limits in the bench file.",
        )  # fmt: skip

    def _recognise(self, answer: bytes) -> Identity:
        """Decode an identity and compare it with the bench file and with that of earlier connections."""
        found = wire.read_identity(self._read_reply(answer).text)
        if not found.verified:
            found = found._replace(serial=self._pin.serial or "")
        return self._recognised.check(found, found.fingerprint)


@lru_cache(maxsize=64)  # an axis at rest keeps the same state
def _read_state(text: str) -> State:
    """Decode the state; ValueError for an unknown mode."""
    reported = wire.read_state(text)
    mode = _MODES.get(reported.mode, Mode.OTHER)
    return State(
        reported.angle_deg, reported.rate_dps, _DRIVES[reported.interlock], mode,
        held=mode is Mode.OFF or reported.interlock is Interlock.OPEN, oscillating=OSCILLATING in reported.dynamics,
        in_control=wire.LOCKED_OUT in reported.supervisor, words=f"mode {reported.mode.value}",
        stale=reported.interlock is Interlock.FAULT,
    )  # fmt: skip


class AcutronicAcl(Table):
    """A Positioner and a RateTable.

    The front panel is locked out while the driver uses the table, and released at the end.
    """

    def __init__(self, setup: Setup[AclOptions, TableLimits, Nothing]) -> None:
        super().__init__(setup.name, AclAxis(setup), setup.options, setup.limits)
