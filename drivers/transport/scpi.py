"""Dialogue with a SCPI instrument: identified, its error queue drained after each write, reconnected after a loss."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from drivers.description import Setup
from drivers.errors import NoAnswer, Refused
from drivers.protocols import scpi
from drivers.recognised import Recognised
from drivers.transport.dialogue import Dialogue, OverDialogue
from drivers.transport.exchange import SyncQuery
from drivers.values import Identity

IDENTITY_QUERY = b"*IDN?"
ReadError = Callable[[bytes], scpi.ErrorEntry]
ERROR_QUERIES: Mapping[bytes, ReadError] = {
    b":SYST:ERR?": scpi.error_entry,  # SCPI-1999
    b":STAT:ERR?": scpi.error_entry,  # Yokogawa
    b"*ESR?": scpi.event_entry,  # IEEE 488.2, for an instrument without a queue
}  # queries of the errors, in the order in which they are tried
MAX_ERRORS = 32


class ScpiLink(OverDialogue):
    """The line to one SCPI instrument.

    Its errors are read by the first of `error_queries` that it answers; `setup.note` receives which, unless it is the
    first of all. `double_read` confirms readings that enter a result. Lifetime: `open`, then `close`; `reopen` when the
    wire was lost. Concurrency: callers queue for the line.
    """

    def __init__(
        self, setup: Setup[Any, Any, Any], *, end: bytes = b"\n",
        read_identity: Callable[[bytes], Identity] = scpi.identity,
        error_queries: Mapping[bytes, ReadError] = ERROR_QUERIES,
    ) -> None:  # fmt: skip
        self._device, self._recognised = setup.name, Recognised(setup.name, setup.identity)
        self._read_identity, self._note = read_identity, setup.note
        self._error_queries = error_queries
        self._error_query = b""  # the query that it answers
        sync_query = SyncQuery(IDENTITY_QUERY, self._recognise)
        self._dialogue = Dialogue(setup, sync_query, end=end, on_connect=self._forget_errors)

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""
        return await self.query(IDENTITY_QUERY, self._recognise)

    async def write(self, commands: str) -> None:
        """Send commands in one message, once; raises Refused with every error that they left in the queue.

        Also returns if the answer is missing or garbled: the caller decides by reading back.
        """
        message = commands.encode() + b";" + self._error_query
        entry = await self._dialogue.send_command(message, self._error_queries[self._error_query])
        if entry is not None and (errors := await self._errors_from(entry)):
            raise Refused(
                self._device, "the instrument refused a command", sent=commands, received="; ".join(errors),
                remedy="Look at its display, and check the levels and limits in the sequence and the bench file.",
            )  # fmt: skip

    def preempt(self, commands: str) -> None:
        """Send commands at once, ahead of everything queued; see LineExchange.preempt."""
        self._dialogue.line.preempt(commands.encode())

    async def _forget_errors(self) -> None:
        """Empty the error queue of errors of earlier sessions."""
        await self._errors_from(await (self._next_error() if self._error_query else self._first_error()))

    async def _first_error(self) -> scpi.ErrorEntry:
        """First entry of the error queue, by the first query that is answered; raises NoAnswer if none is.

        An instrument does not answer an unknown query, and queues an error for it, which is discarded here.
        """
        first, *others = self._error_queries
        for query in (first, *others):
            try:
                entry = await self.query(query, self._error_queries[query])
            except NoAnswer as silent:
                await self.query_once(IDENTITY_QUERY, self._recognise)  # raises if it does not answer at all
                problem = silent
            else:
                self._error_query = query
                if query != first:
                    self._note(f"it does not answer {first.decode()}; its errors are queried by {query.decode()}")
                return entry
        raise problem

    async def _next_error(self) -> scpi.ErrorEntry:
        return await self.query(self._error_query, self._error_queries[self._error_query])

    async def _errors_from(self, entry: scpi.ErrorEntry) -> list[str]:
        """All entries of the error queue, from `entry` on; the queue is empty after it."""
        errors: list[str] = []
        while entry.code != scpi.NO_ERROR:
            errors.append(str(entry))
            if len(errors) == MAX_ERRORS:
                raise Refused(self._device, "its error queue does not become empty", received=errors[-1])
            entry = await self._next_error()
        return errors

    def _recognise(self, line: bytes) -> Identity:
        """Decode an identity and compare it with the bench file and with that of earlier connections."""
        return self._recognised.check(self._read_identity(line), line.decode("ascii"))
