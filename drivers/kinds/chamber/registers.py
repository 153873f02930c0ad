"""Registers of a chamber's controller, on a connection that is identified before use, and controllers with them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from drivers.description import Setup
from drivers.errors import BadAnswer, DriverError, LinkLost, NoAnswer, Refused
from drivers.kinds.chamber.controller import Connected
from drivers.kinds.chamber.words import Words
from drivers.protocols.modbus_frames import ReadFunction
from drivers.timing.readback import read_back
from drivers.transport.dialogue import retry_once
from drivers.transport.modbus import GAP_S, ModbusLink

T = TypeVar("T")
Spelled = Callable[[Words], str]
"""Formats registers as numbers for a message."""


class VerifiedRegisters:
    """Register reads, and writes that are proved by reading back.

    After a timeout or a lost connection the next request reconnects and identifies first, by `identify`, which uses
    `link` and raises WrongIdentity. A read without an answer is repeated once, with a note to `setup.note`; a write is
    sent only once.

    Concurrency: one caller at a time.
    """

    def __init__(
        self, setup: Setup[Any, Any, Any], identify: Callable[[], Awaitable[None]], *, gap_s: float = GAP_S
    ) -> None:
        options = setup.options
        self.link = ModbusLink(
            setup.name, setup.wires, setup.address, unit_id=options.unit_id, answer_s=options.answer_timeout,
            gap_s=gap_s,
        )  # fmt: skip
        self._identify, self._note = identify, setup.note

    async def connect(self) -> None:
        """Reconnect and identify, with one retry without an answer.

        Raises CannotConnect and the errors of `identify`.
        """
        await retry_once(self._connect, self._note)

    def close(self) -> None:
        """Close the connection; closing twice is harmless."""
        self.link.close()

    async def _connect(self) -> None:
        await self.link.open()
        await self._verify()

    async def identify(self) -> None:
        """Identify; raises, and closes the connection, if it is another controller."""
        if not self.link.is_open:
            await self.connect()
            return
        try:
            await self._verify()
        except NoAnswer as problem:
            self._note(f"asked again: {problem}")
            await self._connect()

    async def read(self, address: int, count: int, *, function: ReadFunction = 3) -> Words:
        """Read `count` words from the wire address `address`."""
        if not self.link.is_open:
            await self._connect()
        try:
            return await self.link.read(address, count, function=function)
        except NoAnswer as problem:
            self._note(f"asked again: {problem}")
            await self._connect()
            return await self.link.read(address, count, function=function)

    async def set(
        self, address: int, words: Words, what: str, spelled: Spelled, *, many: bool = False, function: ReadFunction = 3
    ) -> None:
        """Write once, then read back and compare register by register; `what` is its name in messages.

        Without an answer, the read-back decides whether the write was executed. Raises Refused if the controller stored
        another value.
        """
        if not self.link.is_open:
            await self._connect()
        count = len(words)
        unanswered: DriverError | None = None
        try:
            await self.link.write(address, words, many=many)
        except (NoAnswer, LinkLost) as problem:
            unanswered = problem
            stored = await self.read(address, count, function=function)  # immediately: the timeout has already passed
        else:
            stored = await read_back(
                lambda: self.read(address, count, function=function), lambda stored: stored == words
            )
        if stored == words:
            return
        if unanswered is not None:
            raise unanswered
        raise Refused(
            self.link.device, f"the controller acknowledged a new {what} and stored another",
            sent=spelled(words), received=spelled(stored),
            remedy="Look at the controller for a lock, a limit or a running profile.",
        )  # fmt: skip

    async def _verify(self) -> None:
        """Identify on the present connection, each query sent once."""
        try:
            await self._identify()
        except DriverError:
            self.link.close()
            raise


class RegisterController(Connected):
    """Part of a Controller with such registers."""

    def __init__(self, setup: Setup[Any, Any, Any], *, gap_s: float = GAP_S) -> None:
        self._pin = setup.identity
        self._registers = VerifiedRegisters(setup, self._identify, gap_s=gap_s)
        self._link = self._registers.link
        super().__init__(self._registers)

    async def _identify(self) -> None:
        """Identify by `_link`, and set `limits_c`; raises WrongIdentity."""
        raise NotImplementedError

    def _decode(self, words: Words, read: Callable[[Words], T], address: object) -> T:
        """Decode the words at an address with `read`; BadAnswer if it raises ValueError."""
        try:
            return read(words)
        except ValueError as problem:
            raise BadAnswer(
                self._link.device, str(problem), sent=f"read {len(words)} registers at {address}",
                received=hexadecimal(words), remedy="Look at the controller for a sensor error.",
            ) from problem  # fmt: skip


def hexadecimal(words: Words) -> str:
    """Format words in hexadecimal, as on the wire."""
    return " ".join(f"{word:04x}" for word in words)


def spelled_by(read: Callable[[Words], float], unit: str = "") -> Spelled:
    """Format registers as the number that `read` decodes, and in hexadecimal; only so if it raises ValueError."""

    def spelled(words: Words) -> str:
        try:
            return f"{read(words):g}{unit} ({hexadecimal(words)})"
        except ValueError:
            return hexadecimal(words)

    return spelled
