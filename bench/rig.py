"""The opened devices of a bench: looked up by role, opened in parallel, made safe in parallel, closed in reverse."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AsyncExitStack
from typing import Self

from bench.errors import BenchError
from drivers.capabilities import (
    Device,
    FrameSource,
    Meter,
    Positioner,
    PulseCounter,
    RateTable,
    Source,
    ThermalChamber,
)
from drivers.errors import DriverError
from drivers.values import Identity

MAKE_SAFE_S = 10.0
OPEN_S = 30.0


class OpenError(BenchError):
    """Some devices could not be opened; one line for each."""

    code = "open"


class Rig:
    """The devices of a bench.

    Lifetime: inside the context every device is connected and identified, or `OpenError` names all that are not.
    Leaving it closes them; it does not make them safe, `make_safe` does.
    """

    def __init__(self, devices: Mapping[str, Device]) -> None:
        self.devices = dict(devices)
        self.identities: dict[str, Identity] = {}
        self._open = AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Opens all devices in parallel; none stays open when that fails, or is cancelled."""
        try:
            self._check(await self._each(self._open.enter_async_context, OPEN_S))
            identities = await self._each(lambda device: device.identify(), OPEN_S)
            self._check(identities)
        except BaseException:
            await self._open.aclose()
            raise
        self.identities = {name: found for name, found in identities.items() if isinstance(found, Identity)}
        return self

    def _check(self, results: Mapping[str, object]) -> None:
        """Raises OpenError for those devices that gave an exception."""
        failed = [str(result) for result in results.values() if isinstance(result, Exception)]
        if failed:
            raise OpenError("\n".join(failed))

    async def __aexit__(self, *exc: object) -> None:
        """Closes the devices in reverse."""
        await self._open.aclose()

    def positioner(self, role: str) -> Positioner:
        """The device of a role as a positioner; a checked plan asks for nothing else."""
        device = self.devices[role]
        if not isinstance(device, Positioner):
            raise TypeError(f"{role} is no positioner")
        return device

    def table(self, role: str) -> RateTable:
        """The device of a role as a rate table."""
        device = self.devices[role]
        if not isinstance(device, RateTable):
            raise TypeError(f"{role} is no rate table")
        return device

    def chamber(self, role: str) -> ThermalChamber:
        """The device of a role as a chamber."""
        device = self.devices[role]
        if not isinstance(device, ThermalChamber):
            raise TypeError(f"{role} is no thermal chamber")
        return device

    def source(self, role: str) -> Source:
        """The device of a role as a supply or current source."""
        device = self.devices[role]
        if not isinstance(device, Source):
            raise TypeError(f"{role} is no source")
        return device

    def counter(self, role: str) -> PulseCounter:
        """The device of a role as a pulse counter."""
        device = self.devices[role]
        if not isinstance(device, PulseCounter):
            raise TypeError(f"{role} is no pulse counter")
        return device

    def frame_source(self, role: str) -> FrameSource:
        """The device of a role as one that sends frames: a pulse counter, or telemetry."""
        device = self.devices[role]
        if not isinstance(device, FrameSource):
            raise TypeError(f"{role} sends no frames")
        return device

    def meter(self, role: str) -> Meter:
        """The device of a role as a voltmeter or an ammeter."""
        device = self.devices[role]
        if not isinstance(device, Meter):
            raise TypeError(f"{role} is no meter")
        return device

    async def make_safe(self, limit_s: float = MAKE_SAFE_S) -> dict[str, str]:
        """Makes every device safe, in parallel and in bounded time; what could not be made safe, and why."""
        done = await self._each(lambda device: device.make_safe(), limit_s)
        return {name: str(result) for name, result in done.items() if isinstance(result, BaseException)}

    async def _each(self, act: Callable[[Device], Awaitable[object]], limit_s: float) -> dict[str, object]:
        """What `act` gives or raises for each device; one that fails or hangs does not hold the others up."""

        async def one(name: str, device: Device) -> object:
            try:
                async with asyncio.timeout(limit_s):
                    return await act(device)
            except DriverError as problem:
                return problem
            except TimeoutError:
                return TimeoutError(f"{name}: not within {limit_s:g} s")
            except Exception as problem:  # noqa: BLE001  the other devices are made safe all the same
                return RuntimeError(f"{name}: {type(problem).__name__}: {problem}")

        names = list(self.devices)
        results = await asyncio.gather(*(one(name, self.devices[name]) for name in names))
        return dict(zip(names, results, strict=True))
