"""Question and answer over a line of text: one at a time, with a deadline, and fenced after a surprise.

A timeout is a data-integrity event: a late answer would be taken for the answer to the next question. After a timeout,
an answer with something behind it, or a broken exchange, the channel is not trusted: it is drained until it has been
quiet for longer than a late answer takes, the driver asks who is there, and only then does the next exchange go out.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from drivers.errors import BadAnswer, LinkLost, NoAnswer

ANSWER_LIMIT_BYTES = 65_536
DRAIN_LIMIT_S = 10.0


@dataclass(frozen=True, slots=True)
class Pace:
    """How long an answer may take, and how long silence must last before a late one is no longer expected."""

    answer_s: float = 2.0
    quiet_s: float = 1.0


class LineExchange(asyncio.Protocol):
    """A line-terminated dialogue with one instrument; give it to a transport, then `ask` and `tell`.

    Concurrency: callers queue for the line. Cancelling an exchange leaves the channel untrusted, as a timeout does.
    """

    def __init__(self, device: str, *, end: bytes = b"\n", pace: Pace | None = None) -> None:
        self.device = device
        self._end = end
        self._pace = pace or Pace()
        self._turn = asyncio.Lock()
        self._received = bytearray()
        self._waiter: asyncio.Future[None] | None = None
        self._transport: asyncio.Transport | None = None
        self._lost: str = "not connected"
        self._trusted = True
        self._verify: Callable[[], Awaitable[None]] | None = None

    def verify_with(self, verify: Callable[[], Awaitable[None]]) -> None:
        """Sets what proves, after a surprise, that questions and answers match again; it uses `ask_unfenced`."""
        self._verify = verify

    async def ask(self, command: bytes, *, answer_s: float | None = None) -> bytes:
        """Sends `command` and a terminator; the answer without its terminator.

        Raises NoAnswer after `answer_s`, BadAnswer when more than one line came back, LinkLost.
        """
        async with self._turn:
            await self._ensure_trusted()
            return await self.ask_unfenced(command, answer_s=answer_s)

    async def tell(self, command: bytes) -> None:
        """Sends `command` and a terminator; the dialect gives no answer to it."""
        async with self._turn:
            await self._ensure_trusted()
            self._send(command)

    async def ask_unfenced(self, command: bytes, *, answer_s: float | None = None) -> bytes:
        """One exchange without the fence; only for what `verify_with` was given."""
        deadline_s = self._pace.answer_s if answer_s is None else answer_s
        if self._received:
            stray = self._printable()
            self._trusted = False
            raise BadAnswer(self.device, "said something unasked", received=stray)
        self._trusted = False  # until the whole answer is here
        self._send(command)
        try:
            async with asyncio.timeout(deadline_s):
                answer = await self._line()
        except TimeoutError:
            raise NoAnswer(
                self.device, f"no answer within {deadline_s:g} s", sent=_printable(command), received=self._printable(),
                remedy="Check that the instrument is on and its cable and address are right.",
            ) from None  # fmt: skip
        if self._received:
            raise BadAnswer(
                self.device, "more than one line came back", sent=_printable(command),
                received=_printable(answer) + " then " + self._printable(),
            )  # fmt: skip
        self._trusted = True
        return answer

    def distrust(self) -> None:
        """Fences the channel, after an answer that the dialect does not allow."""
        self._trusted = False

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""
        if self._transport is not None:
            self._transport.close()

    async def _ensure_trusted(self) -> None:
        if self._trusted:
            return
        await self._drain()
        if self._verify is not None:
            await self._verify()
        self._trusted = True

    async def _drain(self) -> None:
        """Throws away what comes until the line has been quiet for long enough."""
        try:
            async with asyncio.timeout(DRAIN_LIMIT_S):
                while True:
                    self._received.clear()
                    try:
                        async with asyncio.timeout(self._pace.quiet_s):
                            await self._more()
                    except TimeoutError:
                        return
        except TimeoutError:
            raise BadAnswer(self.device, f"does not stop talking within {DRAIN_LIMIT_S:g} s") from None

    def _send(self, command: bytes) -> None:
        if self._transport is None or self._lost:
            raise LinkLost(self.device, self._lost, sent=_printable(command))
        self._transport.write(command + self._end)

    async def _line(self) -> bytes:
        while (cut := self._received.find(self._end)) < 0:
            if len(self._received) > ANSWER_LIMIT_BYTES:
                raise BadAnswer(self.device, "an answer without an end", received=self._printable())
            await self._more()
        answer = bytes(self._received[:cut])
        del self._received[: cut + len(self._end)]
        return answer

    async def _more(self) -> None:
        if self._lost:
            raise LinkLost(self.device, self._lost)
        self._waiter = asyncio.get_running_loop().create_future()
        try:
            await self._waiter
        finally:
            self._waiter = None

    def _printable(self) -> str:
        return _printable(bytes(self._received))

    # asyncio.Protocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The wire is open."""
        if not isinstance(transport, asyncio.Transport):
            raise TypeError("a stream transport is needed")
        self._transport, self._lost = transport, ""

    def data_received(self, data: bytes) -> None:
        """Bytes from the instrument."""
        self._received += data
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def connection_lost(self, exc: Exception | None) -> None:
        """The wire is closed; whoever waits learns it now."""
        self._lost = f"the connection was closed ({exc})" if exc else "the connection was closed"
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_exception(LinkLost(self.device, self._lost))


def _printable(data: bytes) -> str:
    """Bytes as a technician can read them; long ones cut."""
    text = repr(data[:80])[1:]
    return text if len(data) <= 80 else f"{text}… ({len(data)} bytes)"
