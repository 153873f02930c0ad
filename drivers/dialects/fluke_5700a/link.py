"""Dialogue with a Fluke 5700A: identified, its fault queue drained after each command, reconnected after a loss."""

from __future__ import annotations

from typing import Any

from drivers.description import Setup
from drivers.dialects.fluke_5700a import wire
from drivers.errors import BadAnswer, Refused, WrongIdentity
from drivers.protocols import scpi
from drivers.recognised import Recognised
from drivers.transport.dialogue import Dialogue, OverDialogue, retry_once
from drivers.transport.exchange import Pace, SyncQuery
from drivers.values import Identity

ANSWER_S = 5.0  # a calibrator delays commands while it changes its range
MAX_FAULTS = 32


class FlukeLink(OverDialogue):
    """The line to one calibrator.

    Every message is one command or one query, and the next one waits for an answer: the input buffer of 128 bytes never
    overflows. `double_read` confirms readings that enter a result. Lifetime: `open`, then `close`; `reopen` when the
    wire was lost. Concurrency: callers queue.
    """

    def __init__(self, setup: Setup[Any, Any, Any], *, end: bytes) -> None:
        self._device, self._end, self._note = setup.name, end, setup.note
        self._recognised = Recognised(setup.name, setup.identity)
        sync_query = SyncQuery(wire.IDENTITY_QUERY, self._recognise)
        self._dialogue = Dialogue(setup, sync_query, end=end, pace=Pace(answer_s=ANSWER_S))

    async def open(self) -> None:
        """Connect, identifies, and empties the fault queue; raises CannotConnect, WrongIdentity or BadAnswer."""
        try:
            await super().open()
            await retry_once(self.faults, self._note)  # errors of earlier sessions
        except BadAnswer as problem:
            self.close()
            raise BadAnswer(
                self._device, problem.problem, sent=problem.sent, received=problem.received,
                remedy="If it echoes commands: set its remote interface to COMPUTER, not TERMINAL. "
                "Else check baud rate, parity and terminator in its RS-232 menu and in the bench file.",
            ) from problem  # fmt: skip
        except BaseException:
            self.close()
            raise

    async def reopen(self) -> bool:
        """Connect and identify again if the connection was lost; return whether it was."""
        lost = await super().reopen()
        if lost:
            await retry_once(self.faults, self._note)
        return lost

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""
        return await self.query(wire.IDENTITY_QUERY, self._recognise)

    async def write(self, command: str) -> list[str]:
        """Send a command once; return the faults in the queue after it.

        Also returns if the answer is missing or garbled: the caller decides by reading back.
        """
        message = command.encode() + self._end + wire.FAULT_QUERY
        fault = await self._dialogue.send_command(message, wire.read_integer)
        return await self.faults() if fault is None else await self._faults_from(fault)

    def preempt(self, *commands: str) -> None:
        """Send commands at once, ahead of everything queued; see LineExchange.preempt."""
        self._dialogue.line.preempt(self._end.join(command.encode() for command in commands))

    async def faults(self) -> list[str]:
        """Read every fault of the queue with its text; the queue is empty after it.

        Raises NoAnswer if one may have been lost: each is reported only once.
        """
        return await self._faults_from(await self.query_once(wire.FAULT_QUERY, wire.read_integer))

    async def _faults_from(self, fault: int) -> list[str]:
        found: list[str] = []
        while fault != wire.NO_FAULT:
            found.append(f"{fault} {await self.query(wire.EXPLAIN_QUERY.format(fault).encode(), wire.read_text)}")
            if len(found) == MAX_FAULTS:
                raise Refused(self._device, "its fault queue does not become empty", received=found[-1])
            fault = await self.query_once(wire.FAULT_QUERY, wire.read_integer)
        return found

    def _recognise(self, line: bytes) -> Identity:
        """Decode an identity and compare it with the bench file and with that of earlier connections."""
        found = scpi.identity(line)
        if found.model not in wire.MODELS:
            raise WrongIdentity(
                self._device, f"a {found.model} is none of {', '.join(wire.MODELS)}; its status may be different",
                received=line.decode("ascii"), remedy="Correct driver or connection in the bench file.",
            )  # fmt: skip
        return self._recognised.check(found, line.decode("ascii"))
