"""Query and answer over a line of text: one at a time, with a time limit, and resynchronised after an error.

A timeout is a data-integrity event: a late answer would be taken for the answer to the next query. After a timeout, an
undecodable answer, unsolicited bytes or a cancelled exchange the channel is out of sync: it is drained until it has
been silent for longer than a late answer takes, a query with an unmistakable answer (the sync query) is sent, and only
then the next exchange.

Without numbered answers no client can detect a duplicated answer that arrives during the next query; on a serial line,
where bytes arrive slowly, a query therefore waits for a short silence.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from drivers.errors import BadAnswer, LinkLost, NoAnswer, Refused
from drivers.timing.awake import fair_timeout
from drivers.transport.memory import let_arrive
from drivers.transport.stream_end import StreamEnd

T = TypeVar("T")

ANSWER_LIMIT_BYTES = 65_536
DRAIN_LIMIT_S = 10.0

Framing = Callable[[bytearray], tuple[int, int] | None]
"""Finds the first complete answer in received bytes: its length without and with its end; None until it is complete."""

Wrap = Callable[[bytes], bytes]
"""Encodes a command as bytes for the wire."""


class Pace(NamedTuple):
    """Time limits of a line.

    An answer may take `answer_s`; after a silence of `quiet_s` a late one is no longer expected; a query is sent after
    a silence of `gap_s`.
    """

    answer_s: float = 2.0
    quiet_s: float = 1.0
    gap_s: float = 0.0


DEFAULT_PACE = Pace()


class SyncQuery(NamedTuple):
    """A query without effect, and a check that raises unless its answer comes from the right instrument."""

    question: bytes
    check: Callable[[bytes], object]


def lines_ending(end: bytes) -> Framing:
    """Framing of answers that end with `end`."""

    def first_line(received: bytearray) -> tuple[int, int] | None:
        cut = received.find(end)
        return None if cut < 0 else (cut, cut + len(end))

    return first_line


class LineExchange(StreamEnd):
    """A line-terminated dialogue with one instrument; give it to a transport, then `query`.

    `framing` finds answers that are not lines. `wrap` encodes commands that are not lines. With `close_on_silence` a
    connection without an answer even to the sync query is closed, so that its owner opens another: a network connection
    may be open at one end only.

    Concurrency: callers queue for the line. Cancelling an exchange leaves the channel out of sync, as a timeout does.
    """

    def __init__(
        self, device: str, sync_query: SyncQuery, *, end: bytes = b"\n", framing: Framing | None = None,
        wrap: Wrap | None = None, pace: Pace = DEFAULT_PACE, close_on_silence: bool = False,
    ) -> None:  # fmt: skip
        super().__init__()
        self.device = device
        self._sync_query = sync_query
        self._wrap = wrap or (lambda command: command + end)
        self._framing = framing or lines_ending(end)
        self._pace, self._close_on_silence = pace, close_on_silence
        self._turn = asyncio.Lock()
        self._received = bytearray()
        self._received_at_s = -math.inf
        self._preemptions = 0
        self._sync_errors = 0  # communication errors since the last sync query; in sync at 0

    async def query(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """Send `question` and a terminator; decode the answer, without its terminator, with `read`.

        Raises NoAnswer after `answer_s` (the pace's by default), BadAnswer if `read` raises ValueError, for more than
        one line, or for bytes received before the query, Refused if preempted, and LinkLost.
        """
        async with self._turn:
            await self._make_ready()
            return await self._exchange(question, read, answer_s)

    async def send_command(
        self, command: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None
    ) -> T | None:
        """Send, once, a command that moves or energises; as `query`, but None if its answer is missing or garbled.

        It is then unknown whether it was executed: read back, and decide. NoAnswer and BadAnswer are raised only if the
        command was not sent.
        """
        preemptions = self._preemptions
        async with self._turn:
            await self._make_ready()
            if self._preemptions != preemptions:
                raise Refused(self.device, "not sent, the instrument is being made safe", sent=printable(command))
            try:
                return await self._exchange(command, read, answer_s)
            except (NoAnswer, BadAnswer):
                return None

    def preempt(self, command: bytes) -> None:
        """Send `command`, which makes an instrument safe, at once.

        The running exchange ends with Refused, and queued commands are not sent any more. The answer to the command is
        drained before the next exchange. Raises LinkLost.
        """
        self._preemptions += 1
        self._sync_errors += 1
        self._send(command)
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_exception(Refused(self.device, "aborted, the instrument is being made safe"))

    def mark_out_of_sync(self) -> None:
        """Mark the channel as out of sync: it is drained and verified before the next exchange."""
        self._sync_errors += 1

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""
        self.lost = self.lost or "the connection was closed by this program"
        if self._transport is not None:
            self._transport.close()

    async def _make_ready(self) -> None:
        if self._sync_errors:
            await self._resynchronise()
        else:
            await self._check_unsolicited()

    async def _exchange(self, question: bytes, read: Callable[[bytes], T], answer_s: float | None = None) -> T:
        deadline_s = self._pace.answer_s if answer_s is None else answer_s
        until_s = asyncio.get_running_loop().time() + deadline_s
        self._sync_errors += 1  # until the answer is complete and decoded
        self._send(question)
        while (line := self._take_line()) is None and let_arrive(self._transport, until_s):
            pass  # answer of a simulator in this process, without a timer
        if line is None:
            line = await self._line_until(until_s, deadline_s, question)
        if self._received:
            raise BadAnswer(
                self.device, "more than one line was received", sent=printable(question),
                received=f"{printable(line)} then {self._leftover()}",
            )  # fmt: skip
        try:
            value = read(line)
        except ValueError as problem:
            raise BadAnswer(
                self.device, f"an invalid answer: {problem}", sent=printable(question),
                received=printable(line), remedy="Check the line settings and that nobody else uses this port.",
            ) from problem  # fmt: skip
        self._sync_errors -= 1
        return value

    async def _check_unsolicited(self) -> None:
        """Wait until the line has been silent for the gap; raises BadAnswer for unsolicited data."""
        if self._pace.gap_s:
            silent_s = asyncio.get_running_loop().time() - self._received_at_s
            if silent_s < self._pace.gap_s:
                await asyncio.sleep(self._pace.gap_s - silent_s)
        if self._received:
            self._sync_errors += 1
            raise BadAnswer(
                self.device, "sent unsolicited data", received=self._leftover(),
                remedy="Nothing was sent. Check that nobody else uses this port, and the terminator in the bench file.",
            )  # fmt: skip

    async def _resynchronise(self) -> None:
        """Drain the channel and verify that queries and answers match again.

        Without an answer the connection is closed, if it `close_on_silence`: its other end may be gone.
        """
        sync_errors = self._sync_errors
        await self._drain()
        try:
            await self._exchange(self._sync_query.question, self._sync_query.check)
        except NoAnswer:
            if self._close_on_silence:
                self.lost = "no more answers"
                self.close()
            raise
        self._sync_errors -= sync_errors

    async def _drain(self) -> None:
        """Discard received bytes until the line has been silent for long enough."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + DRAIN_LIMIT_S
        while True:
            self._received.clear()
            try:
                async with fair_timeout(self._pace.quiet_s):
                    await self.more()
            except TimeoutError:
                return
            if loop.time() > deadline_s:
                raise BadAnswer(
                    self.device, f"is not silent within {DRAIN_LIMIT_S:g} s", received=self._leftover(),
                    remedy="Check the line settings, and that the instrument is not in a talk-only mode.",
                )  # fmt: skip

    def _send(self, command: bytes) -> None:
        if self._transport is None or self.lost:
            raise LinkLost(self.device, self.lost, sent=printable(command))
        self._transport.write(self._wrap(command))

    async def _line_until(self, until_s: float, deadline_s: float, question: bytes) -> bytes:
        """Receive the answer to a query; raises NoAnswer, BadAnswer for one without an end, and LinkLost."""
        try:
            async with fair_timeout(until_s - asyncio.get_running_loop().time()):
                while (line := self._take_line()) is None:
                    if len(self._received) > ANSWER_LIMIT_BYTES:
                        raise BadAnswer(self.device, "an answer without an end", received=self._leftover())
                    await self.more()
                return line
        except TimeoutError:
            raise NoAnswer(
                self.device, f"no answer within {deadline_s:g} s", sent=printable(question), received=self._leftover(),
                remedy="Check that the instrument is on, its cable and address, and the line terminator.",
            ) from None  # fmt: skip

    def _take_line(self) -> bytes | None:
        """Take the first line out of the received bytes; None while it is incomplete."""
        found = self._framing(self._received)
        if found is None:
            return None
        length, whole = found
        line = bytes(self._received[:length])
        del self._received[:whole]
        return line

    def _loss(self) -> Exception:
        return LinkLost(self.device, self.lost)

    def _leftover(self) -> str:
        return printable(bytes(self._received)) if self._received else ""

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the instrument."""
        self._received += data
        self._received_at_s = asyncio.get_running_loop().time()
        super().data_received(data)


def printable(data: bytes) -> str:
    """Format bytes as readable text; long ones cut."""
    text = repr(data[:80])[1:]
    return text if len(data) <= 80 else f"{text}… ({len(data)} bytes)"


def printable_hex(data: bytes | bytearray) -> str:
    """Format bytes in hexadecimal; long ones cut."""
    return data[:40].hex(" ") + (f" … ({len(data)} bytes)" if len(data) > 40 else "")
