"""Text line to a chamber's controller, on a connection that is identified before use, and controllers on it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from drivers.description import Setup
from drivers.errors import NoAnswer, Refused
from drivers.kinds.chamber.controller import Connected, Control
from drivers.kinds.chamber.refusal import Refusal
from drivers.kinds.chamber.tenths import as_stored
from drivers.recognised import Recognised
from drivers.timing.readback import read_back
from drivers.transport.dialogue import Dialogue, retry_once
from drivers.transport.exchange import Framing, Pace, SyncQuery, Wrap
from drivers.values import Identity

T = TypeVar("T")
Read = Callable[[bytes], T | Refusal]


class VerifiedLine:
    """Queries that are repeated once, and commands that are sent only once.

    After a lost connection the next exchange reconnects and identifies first, by `identify`, which uses `query_once`
    and raises WrongIdentity; after any other communication error `sync_query` is sent first. For `order_gap_s` after a
    command nothing is sent. Refusals are raised as Refused and not repeated. `double_read` confirms readings that enter
    a result.

    Concurrency: one caller at a time.
    """

    def __init__(
        self, setup: Setup[Any, Any, Any], sync_query: SyncQuery, identify: Callable[[], Awaitable[None]],
        pace: Pace, *,
        end: bytes = b"\n", framing: Framing | None = None, wrap: Wrap | None = None, order_gap_s: float = 0.0,
    ) -> None:  # fmt: skip
        self._device, self._note = setup.name, setup.note
        self._identify, self._order_gap_s = identify, order_gap_s
        self._dialogue = Dialogue(
            setup, sync_query, end=end, framing=framing, wrap=wrap, pace=pace, on_connect=identify
        )
        self.double_read = self._dialogue.double_read
        self._busy_until_s = -math.inf

    async def connect(self) -> None:
        """Reconnect and identify; raises CannotConnect and the errors of `identify`."""
        await self._dialogue.open()

    def close(self) -> None:
        """Close the wire; closing twice is harmless."""
        self._dialogue.close()

    async def identify(self) -> None:
        """Identify; raises, and closes the connection, if it is another controller."""
        if await self._dialogue.reopen():
            return
        try:
            await retry_once(self._identify, self._note)
        except BaseException:
            self._dialogue.close()  # the identity is unknown: the next exchange reconnects and identifies first
            raise

    async def query(self, question: str, read: Read[T]) -> T:
        """Query and decode with `read`, repeated once without an answer; see LineExchange.query."""
        await self._dialogue.reopen()
        try:
            return await self.query_once(question, read)
        except NoAnswer as problem:
            self._note(f"asked again: {problem}")
            await self._dialogue.reopen()
            return await self.query_once(question, read)

    async def query_once(self, question: str, read: Read[T]) -> T:
        """The same on the present connection, sent once."""
        await self._rest()
        return self._taken(question, await self._dialogue.line.query(question.encode("latin-1"), read))

    async def send_command(self, command: str, read: Read[T]) -> T | None:
        """Send a command once; None if its answer is missing or garbled, and the read-back has to decide."""
        await self._dialogue.reopen()
        await self._rest()
        try:
            return self._taken(command, await self._dialogue.send_command(command.encode("latin-1"), read))
        finally:
            self._busy_until_s = asyncio.get_running_loop().time() + self._order_gap_s

    def _taken(self, sent: str, answer: T | Refusal) -> T:
        if isinstance(answer, Refusal):
            raise Refused(
                self._device, "the controller refused a command", sent=sent, received=str(answer),
                remedy="Check the state of the controller, other masters, and protected settings.",
            )  # fmt: skip
        return answer

    async def _rest(self) -> None:
        await asyncio.sleep(max(0.0, self._busy_until_s - asyncio.get_running_loop().time()))


class TextController(Connected):
    """Part of a Controller on such a line: recognised by its answers, its set points in tenths of a degree."""

    can_start = True

    def __init__(self, setup: Setup[Any, Any, Any], line: VerifiedLine) -> None:
        self._device, self._pin, self._line = setup.name, setup.identity, line
        self._recognised = Recognised(setup.name, setup.identity)
        super().__init__(line)

    def _identity(self) -> Identity:
        return self._recognised.identity or Identity()

    def as_stored(self, temperature_c: float) -> float:
        """Set point as stored: rounded to a tenth of a degree."""
        return as_stored(temperature_c)

    async def _expect_started(self, control: Callable[[], Awaitable[tuple[Control, str]]], sent: str) -> None:
        found, why = await read_back(control, lambda found: found[0] is Control.SET_POINT)
        if found is not Control.SET_POINT:
            raise Refused(
                self._device, "the chamber did not start", sent=sent, received=why,
                remedy="Start it by hand at the chamber.",
            )  # fmt: skip
