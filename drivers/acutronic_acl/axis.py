"""The conversation about one axis with an Acutrol3000: looks, commands, interlock and lock-outs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from drivers.acutronic_acl import wire
from drivers.acutronic_acl.description import AclLimits, AclOptions
from drivers.acutronic_acl.turns import TurnCounter
from drivers.acutronic_acl.wire import Interlock, Mode, Reply, State
from drivers.description import Setup, check_identity, still_the_same
from drivers.errors import InstrumentFault, Refused
from drivers.transport.dialogue import Dialogue
from drivers.transport.exchange import Pace, Proof
from drivers.values import Identity

T = TypeVar("T")

ANSWER_S = 1.0  # 2 ms as a rule
INTERLOCK_STEP_S = 0.25  # what start-up scripts of others leave between two steps


class AclAxis:
    """One axis of a controller.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost. Concurrency: callers queue for the line.
    """

    def __init__(self, setup: Setup[AclOptions, AclLimits, Any]) -> None:
        self._device, self._pin = setup.name, setup.identity
        self._number, self._byte_order = setup.options.axis, setup.options.byte_order
        self._turns = TurnCounter(setup.limits.angle)
        self._identity: Identity | None = None
        self._locked_out = False
        framing = partial(wire.whole_answer, order=self._byte_order)
        proof = Proof(wire.ASK_IDENTITY.encode(), self._recognise)
        self._dialogue = Dialogue(
            setup.name, setup.wires, setup.address, proof, framing=framing, pace=Pace(ANSWER_S), note=setup.note
        )  # fmt: skip

    async def open(self) -> None:
        """Connects and identifies; raises CannotConnect or WrongIdentity."""
        await self._dialogue.open()

    async def reopen(self) -> None:
        """Connects and identifies again if the wire was lost; else nothing."""
        await self._dialogue.reopen()

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""
        self._dialogue.close()

    async def identify(self) -> Identity:
        """Who is there now; raises WrongIdentity when it is not who was there before."""
        return await self._dialogue.ask(wire.ASK_IDENTITY.encode(), self._recognise)

    async def look(self) -> State:
        """What the axis does now, its angle over whole turns."""
        state = await self._ask(wire.ask_state(self._number), wire.read_state)
        return self._turns.count(asyncio.get_running_loop().time(), state)

    async def check_interlock(self, state: State, sent: str = "") -> None:
        """Raises InstrumentFault when the interlock has a fault, with its reasons; `sent` met it."""
        if state.interlock is not Interlock.FAULT:
            return
        reasons = await self._ask(wire.ask_faults(self._number), wire.read_faults)
        raise InstrumentFault(
            self._device, f"axis {self._number} has an interlock fault: {reasons or 'no reason told'}", sent=sent,
            remedy="Remove the cause, reset the interlock at the controller (INTERLOCK:RESET), then run again.",
        )  # fmt: skip

    async def make_ready(self) -> State:
        """Takes control and energises the drive, unless that is so already; what the axis then does.

        Raises InstrumentFault when a fault is latched: resetting it is for a person at the controller; Refused when
        the drive stays off.
        """
        state = await self.look()
        await self.check_interlock(state)
        self._locked_out = True
        if wire.LOCKED_OUT not in state.supervisor:
            await self.set(*wire.lock_out(True))
        if state.interlock is not Interlock.CLOSED:
            for command in (wire.enter(Mode.OFF, self._number), wire.energise(self._number)):
                await self.order(command)
                await asyncio.sleep(INTERLOCK_STEP_S)
        state = await self.look()
        if state.interlock is not Interlock.CLOSED:
            raise Refused(
                self._device, f"the drive of axis {self._number} stays off", sent=wire.energise(self._number),
                received=f"interlock {state.interlock.value}",
                remedy="Check the emergency stop, the doors and the amplifier, then run again.",
            )  # fmt: skip
        return state

    async def give_back(self) -> None:
        """Unlocks the front panel and other interfaces, if this session used the table."""
        if self._locked_out:
            self._locked_out = False
            await self.set(*wire.lock_out(False))

    async def set(self, *commands: str) -> None:
        """Sends what moves nothing by itself; raises Refused, and NoAnswer when nobody knows whether it holds."""
        for command in commands:
            await self._accepted(command, await self._dialogue.ask(command.encode(), self._read_reply))

    async def order(self, command: str) -> None:
        """Sends what moves or energises, once; raises InstrumentFault or Refused when the answer is an error.

        Returns as well when the answer is missing or garbled: what the caller reads back decides.
        """
        reply = await self._dialogue.order(command.encode(), self._read_reply)
        if reply is not None:
            await self._accepted(command, reply)

    def stop_at_once(self) -> None:
        """Holds rate zero, before anything else that is to be said; raises LinkLost."""
        self._dialogue.line.cut_in(wire.enter(Mode.OFF, self._number).encode())

    async def _ask(self, question: str, read: Callable[[str], T]) -> T:
        """What `read` makes of an answer; raises Refused when it is an error."""

        def read_text(answer: bytes) -> T | Reply:
            reply = self._read_reply(answer)
            return read(reply.text) if reply.code == wire.NO_ERROR else reply

        found = await self._dialogue.ask(question.encode(), read_text)
        if isinstance(found, Reply):
            raise self._refusal(question, found)
        return found

    def _read_reply(self, answer: bytes) -> Reply:
        return wire.read_reply(answer, self._byte_order)

    async def _accepted(self, command: str, reply: Reply) -> None:
        if reply.code != wire.NO_ERROR:
            await self.check_interlock(await self.look(), command)
            raise self._refusal(command, reply)

    def _refusal(self, sent: str, reply: Reply) -> Refused:
        return Refused(
            self._device, "the controller refused a command", sent=sent, received=str(reply),
            remedy="Look at the controller's error queue, and check the axis and the limits in the bench file.",
        )  # fmt: skip

    def _recognise(self, answer: bytes) -> Identity:
        """Reads an identity and compares it with the bench file and with who was there before."""
        found = wire.read_identity(self._read_reply(answer).text)
        if not found.verified:
            found = replace(found, serial=self._pin.serial or "")
        check_identity(self._device, self._pin, found)
        self._identity = still_the_same(self._device, self._identity, found, found.fingerprint)
        return found
