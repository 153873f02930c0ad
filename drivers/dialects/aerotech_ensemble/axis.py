"""Dialogue about one axis with an Ensemble controller: queries, commands and the evaluation of answers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from drivers.description import Nothing, Setup
from drivers.dialects.aerotech_ensemble import wire
from drivers.dialects.aerotech_ensemble.description import EnsembleOptions
from drivers.dialects.aerotech_ensemble.wire import AxisStatus, Outcome, Reply
from drivers.errors import InstrumentFault, Refused, WrongIdentity
from drivers.kinds.head.axis import ANSWER_S, AxisState, OwnLimits
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head
from drivers.recognised import as_stated
from drivers.timing.readback import read_back
from drivers.transport.dialogue import Dialogue, OverDialogue
from drivers.transport.exchange import Pace, SyncQuery
from drivers.values import Identity, Reading

T = TypeVar("T")

NOT_REPORTED = "not reported"


class EnsembleAxis(OverDialogue):
    """One axis of a controller.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost. Concurrency: callers queue for the line.
    """

    limits: OwnLimits | None = None  # the controller does not report it

    def __init__(self, setup: Setup[EnsembleOptions, HeadLimits, Nothing]) -> None:
        self._device, self._name, self._stated = setup.name, setup.options.axis, setup.identity
        self._fingerprint = ""
        sync_query = SyncQuery(wire.FINGERPRINT_QUERY.format(self._name).encode(), self._recognise)
        self._dialogue = Dialogue(setup, sync_query, pace=Pace(ANSWER_S), on_connect=self._do_not_wait)

    async def identify(self) -> Identity:
        """Names stated in the bench file, because the controller has none, and the fingerprint that it reports.

        Raises WrongIdentity when the fingerprint has changed.
        """
        await self._dialogue.query(wire.FINGERPRINT_QUERY.format(self._name).encode(), self._recognise)
        fingerprint = f"{wire.FINGERPRINT_PARAMETER} {self._fingerprint}"
        return as_stated(self._stated, fingerprint, maker="Aerotech", model="Ensemble")

    async def angle(self) -> Reading:
        """Encoder angle (°)."""
        angle_deg = await self._query(wire.FEEDBACK_QUERY.format(self._name), wire.read_angle)
        return Reading(asyncio.get_running_loop().time(), angle_deg)

    async def state(self) -> AxisState:
        """Status bits."""
        status = await self._query(wire.STATUS_QUERY.format(self._name), wire.read_status)
        return AxisState(
            homed=AxisStatus.HOMED in status,
            enabled=AxisStatus.ENABLED in status,
            moving=AxisStatus.MOVING in status,
            in_position=AxisStatus.IN_POSITION in status,
        )

    async def check_faults(self, sent: str = "") -> None:
        """Raise InstrumentFault with the names of the present faults; `sent` is the command that met them."""
        faults = await self._query(wire.FAULT_QUERY.format(self._name), wire.read_fault)
        if faults:
            raise InstrumentFault(
                self._device, f"axis {self._name} has a fault: {wire.name_faults(faults)}", sent=sent,
                received=f"AXISFAULT {int(faults):#x}",
                remedy="Remove the cause, acknowledge the fault at the controller (FAULTACK), then run again.",
            )  # fmt: skip

    async def enable(self) -> None:
        """Energise the motor; raises Refused unless the status confirms it."""
        command = wire.ENABLE.format(self._name)
        await self._send_command(command)
        if not (await read_back(self.state, lambda state: state.enabled)).enabled:
            raise Refused(
                self._device, f"axis {self._name} stays disabled", sent=command,
                remedy="Check the emergency stop and the amplifier, then run again.",
            )  # fmt: skip

    async def prepare(self, rate_dps: float) -> None:
        """Do nothing: the rate is sent with each move."""

    async def start_move(self, angle_deg: float, rate_dps: float, *, answer_s: float) -> None:
        """Start a move to an angle, sent once.

        Returns when the controller has accepted or finished the move, or after `answer_s` if the answer is missing: the
        caller decides by the feedback. Raises Refused, InstrumentFault.
        """
        await self._send_command(wire.move_absolute(self._name, angle_deg, rate_dps), answer_s=answer_s)

    async def abort(self) -> None:
        """Decelerate and hold."""
        await self._send_command(wire.ABORT.format(self._name))

    def abort_at_once(self) -> None:
        """As `abort`, ahead of any queued message; raises LinkLost."""
        self._dialogue.line.preempt(wire.ABORT.format(self._name).encode())

    async def _do_not_wait(self) -> None:
        """Set moves to be acknowledged when they are accepted.

        A controller without this setting acknowledges moves when they are finished; the time limit of a move allows for
        that.
        """
        await self._dialogue.send_command(wire.NO_WAIT.encode(), wire.read_reply)

    async def _query(self, question: str, read: Callable[[str], T]) -> T:
        """Query and decode the data with `read`; raises Refused if the answer has none."""

        def read_data(line: bytes) -> T | Reply:
            reply = wire.read_reply(line)
            return read(reply.data) if reply.outcome is Outcome.DONE else reply

        answer = await self._dialogue.query(question.encode(), read_data)
        if isinstance(answer, Reply):
            raise self._refusal(question, answer)
        return answer

    async def _send_command(self, command: str, *, answer_s: float = ANSWER_S) -> None:
        """Send a command once; raises InstrumentFault or Refused if the answer shows that it was not executed."""
        reply = await self._dialogue.send_command(command.encode(), wire.read_reply, answer_s=answer_s)
        # A controller may answer a move with a timeout ($) although it continues.
        if reply is not None and reply.outcome not in (Outcome.DONE, Outcome.TIMEOUT):
            await self.check_faults(command)
            raise self._refusal(command, reply)

    def _refusal(self, sent: str, reply: Reply) -> Refused:
        words = {
            Outcome.INVALID: "the controller refused a command as invalid",
            Outcome.FAULT: "the controller could not execute a command",
            Outcome.TIMEOUT: "a command timed out inside the controller",
        }
        return Refused(
            self._device, words[reply.outcome], sent=sent, received=str(reply),
            remedy="Look at the controller's own messages, and check the axis name in the bench file.",
        )  # fmt: skip

    def _recognise(self, line: bytes) -> None:
        """Compare the fingerprint with the first one; a controller may refuse to report it."""
        reply = wire.read_reply(line)
        if reply.outcome is Outcome.DONE and reply.data:
            found = reply.data
        elif reply.outcome is Outcome.INVALID and not reply.data:
            found = NOT_REPORTED
        else:
            raise ValueError("not a parameter of an axis")
        if self._fingerprint not in ("", found):
            raise WrongIdentity(
                self._device, f"{wire.FINGERPRINT_PARAMETER} of axis {self._name} is {found}, it was "
                f"{self._fingerprint}", received=str(reply),
                remedy="Another controller, or another parameter file, is at this address.",
            )  # fmt: skip
        self._fingerprint = found


class AerotechEnsemble(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[EnsembleOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, EnsembleAxis(setup), setup.options, setup.limits)
