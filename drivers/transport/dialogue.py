"""The line to one instrument over its life: opened and proved, opened again after the wire was lost."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

from drivers.errors import LinkLost, NoAnswer
from drivers.transport.address import Address
from drivers.transport.exchange import Framing, LineExchange, Pace, Proof
from drivers.transport.wires import Wires

SERIAL_GAP_S = 0.02  # some twenty bytes at 9600 baud
SAFE_LIMIT_S = 5.0


class Dialogue:
    """One line after the other to the same instrument.

    Lifetime: `open`, then `close`; `reopen` when the wire was lost.
    """

    def __init__(
        self, device: str, wires: Wires, address: Address, proof: Proof, *, end: bytes = b"\n",
        framing: Framing | None = None, pace: Pace | None = None,
    ) -> None:  # fmt: skip
        self._device, self._wires, self._address, self._proof = device, wires, address, proof
        self._end, self._framing = end, framing
        self._serial = address.is_serial_line
        pace = pace or Pace()
        self._pace = replace(pace, gap_s=max(pace.gap_s, SERIAL_GAP_S)) if self._serial else pace
        self._line: LineExchange | None = None

    @property
    def line(self) -> LineExchange:
        """The line that is open, or was; raises LinkLost when none ever was."""
        if self._line is None:
            raise LinkLost(self._device, "is not connected")
        return self._line

    async def open(self) -> None:
        """Connects, and asks for the proof; raises CannotConnect, and what the proof raises.

        A serial line is drained first: it may hold what an earlier program asked for.
        """
        self.close()
        self._line = await self._wires.stream(self._device, self._address, self._new_line)
        try:
            if self._serial:
                self._line.distrust()
            await self._line.ask(self._proof.question, self._proof.check)
        except BaseException:
            self.close()
            raise

    async def reopen(self) -> bool:
        """Connects again if the wire was lost; whether it was."""
        if self._line is not None and not self._line.lost:
            return False
        await self.open()
        return True

    def close(self) -> None:
        """Closes the wire; closing twice is harmless."""
        if self._line is not None:
            self._line.close()

    def _new_line(self) -> LineExchange:
        return LineExchange(self._device, self._proof, end=self._end, framing=self._framing, pace=self._pace)


@asynccontextmanager
async def safe_in_time(device: str) -> AsyncIterator[None]:
    """Bounds what makes an instrument safe: NoAnswer after 5 s."""
    try:
        async with asyncio.timeout(SAFE_LIMIT_S) as limit:
            yield
    except TimeoutError as problem:
        if not limit.expired():
            raise
        raise NoAnswer(
            device, f"is not proved safe within {SAFE_LIMIT_S:g} s",
            remedy="Look at the instrument; switch it off at its front panel if in doubt.",
        ) from problem  # fmt: skip
