"""Registers of a chamber's controller behind a connection that is identified before it is used."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from drivers.chamber.words import Words
from drivers.description import unheard
from drivers.errors import DriverError, LinkLost, NoAnswer, Refused
from drivers.transport.modbus import ModbusLink
from drivers.transport.modbus_frames import ReadFunction

Spelled = Callable[[Words], str]
"""Words as numbers for a person."""


class ProvedRegisters:
    """Reads, and writes that are proved by reading back.

    After a timeout or a lost connection the next request connects and identifies first, by `identify`, which asks
    through `link` and raises WrongIdentity. A read without an answer is asked again once, which `note` is told; a write
    is sent once, whatever happens.

    Concurrency: one caller at a time.
    """

    def __init__(
        self, link: ModbusLink, identify: Callable[[], Awaitable[None]], note: Callable[[str], object] = unheard
    ) -> None:
        self.link = link
        self._identify, self._note = identify, note

    async def connect(self) -> None:
        """Connects anew and identifies; raises CannotConnect and what `identify` raises."""
        await self.link.open()
        await self._prove()

    async def identify(self) -> None:
        """Identifies; raises and closes the connection when it is not the controller that it should be."""
        if self.link.is_open:
            await self._prove()
        else:
            await self.connect()

    async def read(self, address: int, count: int, *, function: ReadFunction = 3) -> Words:
        """`count` words from the wire address `address`."""
        if not self.link.is_open:
            await self.connect()
        try:
            return await self.link.read(address, count, function=function)
        except NoAnswer as problem:
            await self.connect()
            words = await self.link.read(address, count, function=function)
            self._note(f"asked again: {problem}")
            return words

    async def set(
        self, address: int, words: Words, what: str, spelled: Spelled, *, many: bool = False, function: ReadFunction = 3
    ) -> None:
        """Writes once, then reads back and compares register by register; `what` is its name for a person.

        When the write has no answer, the read-back decides whether it was carried out. Raises Refused when the
        controller kept something else.
        """
        if not self.link.is_open:
            await self.connect()
        unanswered: DriverError | None = None
        try:
            await self.link.write(address, words, many=many)
        except (NoAnswer, LinkLost) as problem:
            unanswered = problem
        kept = await self.read(address, len(words), function=function)
        if kept == words:
            return
        if unanswered is not None:
            raise unanswered
        raise Refused(
            self.link.device, f"the controller acknowledged a new {what} and kept another",
            sent=spelled(words), received=spelled(kept),
            remedy="Look at the controller for a lock, a limit or a running profile.",
        )  # fmt: skip

    async def _prove(self) -> None:
        """Asks on the connection as it is, each question once."""
        try:
            await self._identify()
        except DriverError:
            self.link.close()
            raise


def hexadecimal(words: Words) -> str:
    """Words as they are on the wire."""
    return " ".join(f"{word:04x}" for word in words)
