"""Connection to one instrument over its life: opened and verified, and reopened after a loss."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from drivers.description import Setup
from drivers.errors import LinkLost, NoAnswer
from drivers.safe_state import DIALOGUE_S
from drivers.timing.awake import fair_timeout
from drivers.transport.double_read import DoubleRead
from drivers.transport.exchange import DEFAULT_PACE, Framing, LineExchange, Pace, SyncQuery, Wrap

T = TypeVar("T")

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0  # between attempts to connect again
SERIAL_GAP_S = 0.02  # about twenty bytes at 9600 baud


async def retry_once(query: Callable[[], Awaitable[T]], note: Callable[[str], object]) -> T:
    """Result of the query `query`; repeated once if there is no answer, with a note.

    If there is none again, raises the first NoAnswer.
    """
    try:
        return await query()
    except NoAnswer as problem:
        note(f"asked again: {problem}")
        first = problem
    try:
        return await query()
    except (NoAnswer, LinkLost) as problem:
        raise first from problem


class ReconnectBackoff:
    """Pauses between attempts to reconnect: 1, 2, 4 … 30 s; the first attempt is immediate."""

    def __init__(self) -> None:
        self._failures, self._next_attempt_s = 0, -math.inf

    def failed(self) -> None:
        """Count a failed attempt."""
        pause_s = min(FIRST_PAUSE_S * 2**self._failures, LONGEST_PAUSE_S)
        self._failures += 1
        self._next_attempt_s = asyncio.get_running_loop().time() + pause_s

    def left_s(self) -> float:
        """Time until the next attempt; 0 or negative if it is due."""
        return self._next_attempt_s - asyncio.get_running_loop().time()


class Dialogue:
    """Successive lines to the same instrument.

    A query is repeated once without an answer, and reconnects after a loss: at once, then after increasing pauses. A
    command does neither: the state of the instrument must be read first. `on_connect` is called on every new line;
    `setup.note` receives repeated queries, and the loss and return of the connection.

    `double_read` confirms readings that enter a result. TCP protects data by a checksum; a serial line does not, even
    behind a serial server.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost.
    """

    def __init__(
        self, setup: Setup[Any, Any, Any], sync_query: SyncQuery, *, end: bytes = b"\n", framing: Framing | None = None,
        wrap: Wrap | None = None, pace: Pace = DEFAULT_PACE, on_connect: Callable[[], Awaitable[object]] | None = None,
    ) -> None:  # fmt: skip
        self._device, self._wires, self._address, self._note = setup.name, setup.wires, setup.address, setup.note
        self._sync_query, self._end, self._framing, self._wrap = sync_query, end, framing, wrap
        self._on_connect = on_connect
        self._in_use = self._opening = False
        self._reconnecting = asyncio.Lock()
        self._backoff = ReconnectBackoff()
        self._serial = setup.address.is_serial_line
        self.double_read = DoubleRead(setup.name, setup.note, checked=not self._serial)
        self._pace = pace._replace(gap_s=max(pace.gap_s, SERIAL_GAP_S)) if self._serial else pace
        self._line: LineExchange | None = None

    @property
    def line(self) -> LineExchange:
        """The open line, or the last one; raises LinkLost before the first."""
        if self._line is None:
            raise LinkLost(self._device, "is not connected")
        return self._line

    @property
    def is_open(self) -> bool:
        """True if the connection is open."""
        return self._line is not None and not self._line.lost

    async def open(self) -> None:
        """Connect, send the sync query, and call `on_connect`; raises CannotConnect, and errors of both.

        Retried once without an answer. A serial line is drained first, because it may hold answers to an earlier
        program.
        """
        await retry_once(self._open, self._note)

    async def _open(self) -> None:
        self._drop()
        self._in_use = self._opening = True
        try:
            self._line = await self._wires.stream(self._device, self._address, self._new_line)
            if self._serial:
                self._line.mark_out_of_sync()
            await self._line.query(self._sync_query.question, self._sync_query.check)
            if self._on_connect is not None:
                await self._on_connect()
        except BaseException:
            self._drop()
            self._backoff.failed()
            raise
        finally:
            self._opening = False
        self._backoff = ReconnectBackoff()

    async def query(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """Send a query, on a new line if the connection was lost; see LineExchange.query, and `open`.

        It must change nothing in the instrument, because it is repeated once without an answer. Raises LinkLost at once
        during a pause between attempts to connect, and if it is not open.
        """
        await self._ensure_open()
        return await retry_once(lambda: self.line.query(question, read, answer_s=answer_s), self._note)

    async def query_once(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """As `query`, but never sent twice: for queries that are answered only once, or that have an effect."""
        await self._ensure_open()
        return await self.line.query(question, read, answer_s=answer_s)

    async def _ensure_open(self) -> None:
        if self._in_use and not self._opening and self.line.lost:
            async with self._reconnecting:
                await self._reconnect()

    async def _reconnect(self) -> None:
        """Reconnect, unless another task just has, or the pause is not over."""
        wait_s = self._backoff.left_s()
        if self.line.lost and wait_s > 0:
            raise LinkLost(self._device, f"is not connected; the next attempt is in {wait_s:.1f} s")
        await self.reopen()

    async def send_command(
        self, command: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None
    ) -> T | None:
        """Send, once, a command that moves or energises; see LineExchange.send_command."""
        self.double_read.command_sent()
        return await self.line.send_command(command, read, answer_s=answer_s)

    async def reopen(self) -> bool:
        """Reconnect if the connection was lost; return whether it was."""
        if self._line is not None and not self._line.lost:
            return False
        why = self._line.lost if self._line is not None else ""
        await self._open()
        if why:
            self._note(f"connected and identified again at {self._address}: {why}")
        return True

    def close(self) -> None:
        """Close the connection for good; closing twice is harmless."""
        self._in_use = False
        self._drop()

    def _drop(self) -> None:
        if self._line is not None:
            self._line.close()

    def _new_line(self) -> LineExchange:
        return LineExchange(
            self._device, self._sync_query, end=self._end, framing=self._framing, wrap=self._wrap, pace=self._pace,
            close_on_silence=self._address.scheme != "serial",
        )  # fmt: skip


class OverDialogue:
    """Common part of what speaks with one instrument over a Dialogue."""

    _dialogue: Dialogue

    async def open(self) -> None:
        """Connect and identify; raises CannotConnect, or WrongIdentity for another instrument."""
        await self._dialogue.open()

    async def reopen(self) -> bool:
        """Connect and identify again if the wire was lost; return whether it was."""
        return await self._dialogue.reopen()

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""
        self._dialogue.close()

    @property
    def double_read(self) -> DoubleRead:
        """Confirmation of readings that enter a result."""
        return self._dialogue.double_read

    async def query(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """Send a query that may be repeated; see Dialogue.query."""
        return await self._dialogue.query(question, read, answer_s=answer_s)

    async def query_once(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """Send a query that the instrument answers only once, or that has an effect; see Dialogue.query_once."""
        return await self._dialogue.query_once(question, read, answer_s=answer_s)


@asynccontextmanager
async def safe_in_time(device: str, within_s: float = DIALOGUE_S) -> AsyncIterator[None]:
    """Limit the time of making an instrument safe: NoAnswer after `within_s`."""
    try:
        async with fair_timeout(within_s) as limit:
            yield
    except TimeoutError as problem:
        if not limit.expired():
            raise
        raise NoAnswer(
            device, f"is not proved safe within {within_s:g} s",
            remedy="Look at the instrument; switch it off at its front panel if in doubt.",
        ) from problem  # fmt: skip
