"""The driver: one reading, asked for whenever somebody looks."""

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
    """A Device that measures and does nothing else; whoever names its reading in a bench file has a thermometer.

    The link identifies whenever it connects, asks a question again once, and connects again after a lost wire.
    """

    def __init__(self, setup: Setup[Nothing, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._link = ScpiLink(setup)

    async def __aenter__(self) -> Self:
        """Connects and identifies; raises CannotConnect or WrongIdentity."""
        await self._link.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Closes the wire."""
        self._link.close()

    async def identify(self) -> Identity:
        """Who is there, by *IDN?; raises WrongIdentity."""
        return await self._link.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """The temperature (°C); no reading while the sensor is open, so that the last one grows stale."""
        found_c = await self._link.ask(wire.TEMPERATURE_QUERY, wire.read_temperature)
        if found_c is None:
            return {TEMPERATURE: []}
        return {TEMPERATURE: [Reading(asyncio.get_running_loop().time(), found_c)]}

    async def make_safe(self) -> None:
        """Nothing moves and nothing is energised: it only shows that it is still there."""
        await self._link.identify()
