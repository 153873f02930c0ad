"""The line to one instrument over its life: opened and proved, opened again after the wire was lost."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import TypeVar

from drivers.errors import LinkLost, NoAnswer
from drivers.safe_state import DIALOGUE_S
from drivers.timing.awake import patience
from drivers.transport.address import Address
from drivers.transport.double_read import Takes
from drivers.transport.exchange import Framing, LineExchange, Pace, Proof, Wrap
from drivers.transport.wires import Wires

T = TypeVar("T")

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0  # between attempts to connect again
SERIAL_GAP_S = 0.02  # some twenty bytes at 9600 baud


async def once_more(ask: Callable[[], Awaitable[T]], note: Callable[[str], object]) -> T:
    """Result of the query `ask`; repeated once if there is no answer, with a note.

    If there is none again, raises the first NoAnswer.
    """
    try:
        return await ask()
    except NoAnswer as problem:
        note(f"asked again: {problem}")
        first = problem
    try:
        return await ask()
    except (NoAnswer, LinkLost) as problem:
        raise first from problem


class Pauses:
    """Between attempts to connect again: 1, 2, 4 … 30 s; the first is at once."""

    def __init__(self) -> None:
        self._failures, self._next_attempt_s = 0, -math.inf

    def failed(self) -> None:
        """An attempt has failed now."""
        pause_s = min(FIRST_PAUSE_S * 2**self._failures, LONGEST_PAUSE_S)
        self._failures += 1
        self._next_attempt_s = asyncio.get_running_loop().time() + pause_s

    def left_s(self) -> float:
        """How long it still is to the next attempt; none is to wait for from 0 down."""
        return self._next_attempt_s - asyncio.get_running_loop().time()


class Dialogue:
    """One line after the other to the same instrument.

    What only reads is asked once more when it has no answer, and connects again when the wire was lost: at once, then
    after longer and longer pauses. A command does neither: what the instrument does by then is to be read first.
    `greet` is what must be said on every new line; `note` is told what was asked again, and that the wire was lost and
    is there again.

    `takes` are of what enters a result. TCP sees to it that what arrives is what was sent; a serial line does not, nor
    does one behind a serial server.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost.
    """

    def __init__(
        self, device: str, wires: Wires, address: Address, proof: Proof, *, end: bytes = b"\n",
        framing: Framing | None = None, wrap: Wrap | None = None, pace: Pace | None = None,
        greet: Callable[[], Awaitable[object]] | None = None, note: Callable[[str], object] = lambda _text: None,
    ) -> None:  # fmt: skip
        self._device, self._wires, self._address, self._proof = device, wires, address, proof
        self._end, self._framing, self._wrap, self._greet = end, framing, wrap, greet
        self._note = note
        self._in_use = self._opening = False
        self._reviving = asyncio.Lock()
        self._pauses = Pauses()
        self._serial = address.is_serial_line
        self.takes = Takes(device, note, checked=not self._serial)
        pace = pace or Pace()
        self._pace = replace(pace, gap_s=max(pace.gap_s, SERIAL_GAP_S)) if self._serial else pace
        self._line: LineExchange | None = None

    @property
    def line(self) -> LineExchange:
        """The line that is open, or was; raises LinkLost when none ever was."""
        if self._line is None:
            raise LinkLost(self._device, "is not connected")
        return self._line

    @property
    def is_open(self) -> bool:
        """Whether the wire is open."""
        return self._line is not None and not self._line.lost

    async def open(self) -> None:
        """Connects, asks for the proof, and greets; raises CannotConnect, and what the proof raises.

        All of it once more when there is no answer. A serial line is drained first: it may hold what an earlier program
        asked for.
        """
        await once_more(self._open, self._note)

    async def _open(self) -> None:
        self._drop()
        self._in_use = self._opening = True
        try:
            self._line = await self._wires.stream(self._device, self._address, self._new_line)
            if self._serial:
                self._line.distrust()
            await self._line.ask(self._proof.question, self._proof.check)
            if self._greet is not None:
                await self._greet()
        except BaseException:
            self._drop()
            self._pauses.failed()
            raise
        finally:
            self._opening = False
        self._pauses = Pauses()

    async def ask(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """One question, on a new line if the wire was lost; see LineExchange.ask, and `open`.

        It changes nothing at the instrument, so that it is asked once more when it has no answer. Raises LinkLost at
        once while the next attempt to connect is still to come, and when it is not open.
        """
        await self._be_open()
        return await once_more(lambda: self.line.ask(question, read, answer_s=answer_s), self._note)

    async def ask_once(self, question: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T:
        """As `ask`, and never sent twice: for what an instrument answers only once, or does when it is asked."""
        await self._be_open()
        return await self.line.ask(question, read, answer_s=answer_s)

    async def _be_open(self) -> None:
        if self._in_use and not self._opening and self.line.lost:
            async with self._reviving:
                await self._revive()

    async def _revive(self) -> None:
        """Reconnect, unless another task just has, or the pause is not over."""
        wait_s = self._pauses.left_s()
        if self.line.lost and wait_s > 0:
            raise LinkLost(self._device, f"is not connected; the next attempt is in {wait_s:.1f} s")
        await self.reopen()

    async def order(self, command: bytes, read: Callable[[bytes], T], *, answer_s: float | None = None) -> T | None:
        """Sends a command that moves or energises, once; see LineExchange.order."""
        self.takes.ordered()
        return await self.line.order(command, read, answer_s=answer_s)

    async def reopen(self) -> bool:
        """Connects again if the wire was lost; whether it was."""
        if self._line is not None and not self._line.lost:
            return False
        why = self._line.why_lost if self._line is not None else ""
        await self._open()
        if why:
            self._note(f"connected and identified again at {self._address}: {why}")
        return True

    def close(self) -> None:
        """Closes the wire for good; closing twice is harmless."""
        self._in_use = False
        self._drop()

    def _drop(self) -> None:
        if self._line is not None:
            self._line.close()

    def _new_line(self) -> LineExchange:
        return LineExchange(
            self._device,
            self._proof,
            end=self._end,
            framing=self._framing,
            wrap=self._wrap,
            pace=self._pace,
            gives_up=self._address.scheme != "serial",
        )


@asynccontextmanager
async def safe_in_time(device: str, within_s: float = DIALOGUE_S) -> AsyncIterator[None]:
    """Bounds what makes an instrument safe: NoAnswer after `within_s`."""
    try:
        async with patience(within_s) as limit:
            yield
    except TimeoutError as problem:
        if not limit.expired():
            raise
        raise NoAnswer(
            device, f"is not proved safe within {within_s:g} s",
            remedy="Look at the instrument; switch it off at its front panel if in doubt.",
        ) from problem  # fmt: skip
