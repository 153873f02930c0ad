"""The registers of one control loop behind a connection that is identified before it is used."""

from __future__ import annotations

from drivers.errors import BadAnswer, DriverError, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.transport.modbus import ModbusLink
from drivers.watlow_f4t.wire import (
    BLOCK_COUNT,
    BLOCK_FIRST,
    DISPLAY_UNIT,
    DISPLAY_UNIT_SERIAL,
    DisplayUnit,
    LoopBlock,
    LoopFormat,
    LoopRegister,
    Words,
)

COLDEST_C, HOTTEST_C = -273.15, 2000.0
NARROWEST_C = 1.0  # set-point limits closer than this are words in the wrong order, which read as almost zero


class LoopRegisters:
    """Reads, and writes that are proved by reading back.

    After a timeout or a lost connection the next request connects and identifies first. A read without an answer is
    asked again once; a write is sent once, whatever happens.

    Concurrency: one caller at a time.
    """

    def __init__(self, link: ModbusLink, form: LoopFormat) -> None:
        self.set_point_limits_c: tuple[float, float] | None = None  # the controller's own, once it is identified
        self._link, self._form, self._device = link, form, link.device

    async def connect(self) -> None:
        """Connects anew and identifies; raises CannotConnect and what `identify` raises."""
        await self._link.open()
        await self._identify()

    async def identify(self) -> None:
        """Makes sure that it is a controller in °C, read in its word order, and the same as before.

        It is known by its set-point limits. Raises WrongIdentity and closes the connection when it is not.
        """
        if self._link.is_open:
            await self._identify()
        else:
            await self.connect()

    def close(self) -> None:
        """Closes the connection; the next request would open it again."""
        self._link.close()

    async def words(self, register: LoopRegister, count: int) -> Words:
        """`count` words from `register`."""
        return await self._read(self._form.address(register), count)

    async def number(self, register: LoopRegister) -> float:
        """A float; BadAnswer when it is not finite."""
        return self._finite(await self.words(register, 2), self._form.address(register))

    async def enumeration(self, register: LoopRegister) -> int:
        """A number whose meaning is a list."""
        return (await self.words(register, 1))[0]

    async def block(self) -> LoopBlock:
        """Set point in force, mode and process value by one request, so all of one instant."""
        address = self._form.address(BLOCK_FIRST)
        words = await self._read(address, BLOCK_COUNT)
        try:
            return self._form.block(words)
        except ValueError as problem:
            raise self._no_number(words, address, problem) from problem

    async def block_singly(self) -> LoopBlock:
        """The same by one request for each value, for a controller that refuses them together."""
        return LoopBlock(
            await self.number(LoopRegister.SET_POINT_IN_FORCE),
            await self.enumeration(LoopRegister.CONTROL_MODE_IN_FORCE),
            await self.number(LoopRegister.PROCESS_VALUE),
        )

    async def set(self, register: LoopRegister, words: Words) -> None:
        """Writes once, then reads back and compares register by register.

        When the write has no answer, the read-back decides whether it was carried out. Raises Refused when the
        controller kept something else.
        """
        if not self._link.is_open:
            await self.connect()
        unanswered: DriverError | None = None
        try:
            await self._link.write(self._form.address(register), words)
        except (NoAnswer, LinkLost) as problem:
            unanswered = problem
        kept = await self.words(register, len(words))
        if kept == words:
            return
        if unanswered is not None:
            raise unanswered
        raise Refused(
            self._device, f"the controller acknowledged a new {_name(register)} and kept another",
            sent=self._readable(words), received=self._readable(kept),
            remedy="Look at the controller for a lock, a limit or a running profile.",
        )  # fmt: skip

    async def _read(self, address: int, count: int) -> Words:
        if not self._link.is_open:
            await self.connect()
        try:
            return await self._link.read(address, count)
        except NoAnswer:
            await self.connect()
            return await self._link.read(address, count)

    async def _identify(self) -> None:
        """Asks on the connection as it is, each question once."""
        try:
            await self._check_unit()
            limits_c = await self._check_limits()
            if self.set_point_limits_c not in (None, limits_c):
                raise WrongIdentity(
                    self._device, "not the controller that was there before, or somebody changed its set-point limits",
                    received=_range(limits_c), remedy="Check the network address in the bench file, then start again.",
                )  # fmt: skip
        except DriverError:
            self._link.close()
            raise
        self.set_point_limits_c = limits_c

    async def _check_unit(self) -> None:
        register = DISPLAY_UNIT_SERIAL if self._link.address.is_serial_line else DISPLAY_UNIT
        (unit,) = await self._link.read(register, 1)
        if unit != DisplayUnit.CELSIUS:
            raise WrongIdentity(
                self._device, "the display unit of the controller is not °C", sent=f"read register {register}",
                received="30, which is °F" if unit == DisplayUnit.FAHRENHEIT else f"{unit}, expected 15",
                remedy="Set the display unit to °C at the controller.",
            )  # fmt: skip

    async def _check_limits(self) -> tuple[float, float]:
        low_c, high_c = [
            self._finite(await self._link.read(address, 2), address)
            for address in map(self._form.address, (LoopRegister.SET_POINT_MIN, LoopRegister.SET_POINT_MAX))
        ]
        if low_c < COLDEST_C or high_c > HOTTEST_C or high_c - low_c < NARROWEST_C:
            raise WrongIdentity(
                self._device, "the set-point limits of the controller make no sense", received=_range((low_c, high_c)),
                remedy="Check options.word_order in the bench file; the data map of the controller must be 1.",
            )  # fmt: skip
        return low_c, high_c

    def _finite(self, words: Words, address: int) -> float:
        try:
            return self._form.value(words)
        except ValueError as problem:
            raise self._no_number(words, address, problem) from problem

    def _no_number(self, words: Words, address: int, problem: ValueError) -> BadAnswer:
        return BadAnswer(
            self._device, str(problem), sent=f"read {len(words)} registers at {address}", received=_hex(words),
            remedy="Look at the controller for a sensor error.",
        )  # fmt: skip

    def _readable(self, words: Words) -> str:
        """Words as numbers for a person, and as they were on the wire."""
        if len(words) == 1:
            return str(words[0])
        try:
            return f"{self._form.value(words):g} ({_hex(words)})"
        except ValueError:
            return _hex(words)


def _name(register: LoopRegister) -> str:
    return register.name.lower().replace("_", " ")


def _range(limits_c: tuple[float, float]) -> str:
    return f"set points from {limits_c[0]:g} to {limits_c[1]:g} °C"


def _hex(words: Words) -> str:
    return " ".join(f"{word:04x}" for word in words)
