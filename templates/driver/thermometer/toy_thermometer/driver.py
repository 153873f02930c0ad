"""The driver: one reading, queried at every poll."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.description import Nothing, Setup
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity, Reading

from toy_thermometer import wire
from toy_thermometer.description import TEMPERATURE


class ToyThermometer:
    """A Device that only measures; a bench file uses its reading as a thermometer.

    The link identifies the instrument at every connection, repeats a query once, and reconnects after a loss.
    """

    def __init__(self, setup: Setup[Nothing, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._link = ScpiLink(setup)

    async def __aenter__(self) -> Self:
        """Connect and identify; raises CannotConnect or WrongIdentity."""
        await self._link.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection."""
        self._link.close()

    async def identify(self) -> Identity:
        """Query the identity by *IDN?; raises WrongIdentity."""
        return await self._link.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Read the temperature (°C); no reading from an open sensor, so that the last one becomes stale."""
        found_c = await self._link.query(wire.TEMPERATURE_QUERY, wire.read_temperature)
        if found_c is None:
            return {TEMPERATURE: []}
        return {TEMPERATURE: [Reading(asyncio.get_running_loop().time(), found_c)]}

    async def make_safe(self) -> None:
        """Query the identity: nothing moves or is energised, so an answer is enough."""
        await self._link.identify()
