"""Dialogue about one axis with an XPS: three connections, queries, calls, and the evaluation of answers.

A connection with a pending call refuses the next one, and a move is answered when it is finished. Moves therefore have
a connection of their own, as in other drivers (BLISS, EPICS). So does stopping: it never waits for the answer to a
query, and is never refused because of one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from drivers.description import Nothing, Setup
from drivers.dialects.newport_xps import wire
from drivers.dialects.newport_xps.description import XpsOptions
from drivers.dialects.newport_xps.wire import GroupState, Profile, Reply
from drivers.errors import InstrumentFault, Refused
from drivers.kinds.head.axis import ANSWER_S, AxisState, OwnLimits
from drivers.kinds.head.description import HeadLimits
from drivers.kinds.head.driver import Head
from drivers.protocols import scpi
from drivers.recognised import Recognised
from drivers.timing.readback import read_back
from drivers.transport.dialogue import Dialogue
from drivers.transport.exchange import Pace, SyncQuery, lines_ending
from drivers.values import Identity, Reading

T = TypeVar("T")

PROFILE_TOLERANCE = 1e-5  # relative: the controller may round a setting


class XpsAxis:
    """One axis of a controller.

    Lifetime: `open`, then `close`; `reopen` when a connection was lost. Concurrency: callers queue for a connection.
    """

    def __init__(self, setup: Setup[XpsOptions, HeadLimits, Nothing]) -> None:
        options = setup.options
        self._device, self._stated = setup.name, setup.identity
        self._group, self._positioner = options.group, f"{options.group}.{options.positioner}"
        self._acceleration_dps2 = options.acceleration
        # The maker is stated, because the controller does not report it.
        self._recognised = Recognised(setup.name, setup.identity.model_copy(update={"maker": None}))
        self.limits: OwnLimits | None = None
        sync_query = SyncQuery(wire.FIRMWARE_QUERY.encode(), self._recognise)
        self._asking, self._moving, self._stopping = (
            Dialogue(setup, sync_query, end=b"", framing=lines_ending(wire.END), pace=Pace(ANSWER_S)) for _ in range(3)
        )
        self.double_read = self._asking.double_read

    async def open(self) -> None:
        """Connect and read the controller's own limits; raises CannotConnect, WrongIdentity, Refused."""
        try:
            for connection in (self._asking, self._moving, self._stopping):
                await connection.open()
            low_deg, high_deg = await self._query(wire.TRAVEL_QUERY.format(self._positioner), _numbers(2))
            rate_dps, _ = await self._query(wire.MAX_MOTION_QUERY.format(self._positioner), _numbers(2))
        except BaseException:
            self.close()
            raise
        self.limits = OwnLimits(low_deg, high_deg, rate_dps)

    async def reopen(self) -> None:
        """Reconnect lost connections that stopping needs; else do nothing."""
        await self._stopping.reopen()
        await self._asking.reopen()

    def close(self) -> None:
        """Close the connections; closing twice is harmless."""
        for connection in (self._asking, self._moving, self._stopping):
            connection.close()

    async def identify(self) -> Identity:
        """Query model and firmware; the serial number is the stated one, because the wire does not report it.

        Raises WrongIdentity if model or firmware differ from the bench file, or have changed.
        """
        firmware = await self._asking.query(wire.FIRMWARE_QUERY.encode(), self._recognise)
        rate_dps, acceleration_dps2 = await self._query(wire.MAX_MOTION_QUERY.format(self._positioner), _numbers(2))
        return Identity(
            maker=self._stated.maker or "Newport", model=firmware.model, serial=self._stated.serial or "",
            firmware=firmware.firmware, verified=False,
            fingerprint=f"{self._positioner} up to {rate_dps:g} °/s and {acceleration_dps2:g} °/s²",
        )  # fmt: skip

    async def angle(self) -> Reading:
        """Encoder angle (°)."""
        (angle_deg,) = await self._query(wire.ANGLE_QUERY.format(self._positioner), _numbers(1))
        return Reading(asyncio.get_running_loop().time(), angle_deg)

    async def state(self) -> AxisState:
        """Status of the group, with the controller's text if it cannot move."""
        status = await self._query(wire.STATUS_QUERY.format(self._group), scpi.integer)
        state = wire.group_state(status)
        at_rest = state is GroupState.READY
        enabled = at_rest or state is GroupState.MOVING
        words = "" if enabled else await self._words(wire.STATUS_TEXT_QUERY.format(status), status)
        return AxisState(
            homed=state not in (GroupState.NOT_INITIALISED, GroupState.NOT_HOMED),
            enabled=enabled,
            moving=state is GroupState.MOVING,
            in_position=at_rest,
            words=words,
        )

    async def check_faults(self, sent: str = "") -> None:
        """Raise InstrumentFault with the positioner's error, or the reason why the group is disabled; met by `sent`."""
        error = await self._query(wire.ERROR_QUERY.format(self._positioner), scpi.integer)
        if error:
            words = await self._words(wire.ERROR_TEXT_QUERY.format(error), error)
            raise InstrumentFault(
                self._device, f"{self._positioner} has an error: {words}", sent=sent, received=f"{error:#x}",
                remedy="Remove the cause, clear the error at the controller (PositionerErrorGet), initialise and home "
                "the group if it says so, then run again.",
            )  # fmt: skip
        status = await self._query(wire.STATUS_QUERY.format(self._group), scpi.integer)
        if wire.group_state(status) is GroupState.TRIPPED:
            words = await self._words(wire.STATUS_TEXT_QUERY.format(status), status)
            raise InstrumentFault(
                self._device, f"group {self._group} was disabled by a fault: {words}", sent=sent,
                received=f"status {status}",
                remedy="Remove the cause, enable the group at the controller, then run again.",
            )  # fmt: skip

    async def enable(self) -> None:
        """Energise the motor; raises Refused unless the status confirms it."""
        call = wire.ENABLE.format(self._group)
        await self._moving.reopen()
        await self._send_command(self._moving, call)
        state = await read_back(self.state, lambda state: state.enabled)
        if not state.enabled:
            raise Refused(
                self._device, f"group {self._group} stays disabled", sent=call, received=state.words,
                remedy="Check the emergency stop and the driver of the motor, then run again.",
            )  # fmt: skip

    async def prepare(self, rate_dps: float) -> None:
        """Set rate and acceleration unless they are set already, and read them back; raises Refused."""
        await self._moving.reopen()
        found = await self._profile()
        wanted = found._replace(rate_dps=rate_dps, acceleration_dps2=self._acceleration_dps2)
        if _alike(found, wanted):
            return
        call = wire.set_profile(self._positioner, wanted)
        await self._send_command(self._moving, call)
        found = await read_back(self._profile, lambda found: _alike(found, wanted))
        if not _alike(found, wanted):
            raise Refused(
                self._device, f"{self._positioner} would move at {found.rate_dps:g} °/s and "
                f"{found.acceleration_dps2:g} °/s², expected {rate_dps:g} °/s and {self._acceleration_dps2:g} °/s²",
                sent=call, remedy="Find the other program that uses the controller; nothing was moved.",
            )  # fmt: skip

    async def _profile(self) -> Profile:
        return Profile(*await self._query(wire.PROFILE_QUERY.format(self._positioner), _numbers(4)))

    async def start_move(self, angle_deg: float, rate_dps: float, *, answer_s: float) -> None:
        """Start a move to an angle, sent once, as prepared; the answer arrives at its end.

        Returns then, or after `answer_s` if the answer is missing: the caller decides by the angle. Raises Refused,
        InstrumentFault.
        """
        await self._send_command(self._moving, wire.move_absolute(self._positioner, angle_deg), answer_s=answer_s)

    async def abort(self) -> None:
        """Decelerate and hold; an axis at rest is no error. A queued move is not sent any more."""
        await self._stopping.reopen()
        self._preempt(self._moving)
        await self._send_command(self._stopping, wire.ABORT.format(self._group), also=wire.NOT_ALLOWED)

    def abort_at_once(self) -> None:
        """As `abort`, ahead of any pending call; raises LinkLost.

        Also sent on the other connections, which refuse it during a call: a queued move there is not sent any more, and
        a dead connection is noticed only by sending on it.
        """
        self._stopping.line.preempt(wire.ABORT.format(self._group).encode())
        for connection in (self._moving, self._asking):
            self._preempt(connection)

    def _preempt(self, connection: Dialogue) -> None:
        if connection.is_open:
            connection.line.preempt(wire.ABORT.format(self._group).encode())

    async def _query(self, question: str, read: Callable[[str], T]) -> T:
        """Query and decode with `read`; raises Refused if the answer is an error."""

        def read_text(answer: bytes) -> T | Reply:
            reply = wire.read_reply(answer)
            return read(reply.text) if reply.code == wire.SUCCESS else reply

        answer = await self._asking.query(question.encode(), read_text)
        if isinstance(answer, Reply):
            raise await self._refusal(question, answer)
        return answer

    async def _send_command(
        self, connection: Dialogue, call: str, *, answer_s: float = ANSWER_S, also: int = wire.SUCCESS
    ) -> None:
        """Make a call once; raises InstrumentFault or Refused if its answer is neither success nor `also`."""
        reply = await connection.send_command(call.encode(), wire.read_reply, answer_s=answer_s)
        if reply is not None and reply.code not in (wire.SUCCESS, also):
            await self.check_faults(call)
            raise await self._refusal(call, reply)

    async def _refusal(self, sent: str, reply: Reply) -> Refused:
        words = await self._words(wire.CODE_TEXT_QUERY.format(reply.code), reply.code)
        return Refused(
            self._device, f"the controller did not execute a call: {words}", sent=sent, received=str(reply),
            remedy="Look at the controller's own page, and check the group and the positioner in the bench file.",
        )  # fmt: skip

    async def _words(self, question: str, number: int) -> str:
        """Text of an error number from the controller; the number if it has none."""
        reply = await self._asking.query(question.encode(), wire.read_reply)
        return reply.text if reply.code == wire.SUCCESS and reply.text else f"number {number}"

    def _recognise(self, answer: bytes) -> Identity:
        """Compare model and firmware with the bench file, and with the first connection; ValueError if it is no XPS."""
        reply = wire.read_reply(answer)
        if reply.code != wire.SUCCESS:
            raise ValueError("no version of a firmware")
        found = Identity(model=wire.read_model(reply.text), firmware=reply.text, verified=False)
        return self._recognised.check(found, str(reply))


def _numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    return lambda text: wire.read_numbers(text, count)


def _alike(one: Profile, other: Profile) -> bool:
    return all(abs(a - b) <= PROFILE_TOLERANCE * abs(b) for a, b in zip(one[:2], other[:2], strict=True))


class NewportXps(Head):
    """A Positioner."""

    def __init__(self, setup: Setup[XpsOptions, HeadLimits, Nothing]) -> None:
        super().__init__(setup.name, XpsAxis(setup), setup.options, setup.limits)
