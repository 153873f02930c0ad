"""Simulated SCPI current sources behind a tapped wire, and what drivers for them are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import DriverDescription, IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.keithley_6220.description import DESCRIPTION
from drivers.dialects.keithley_6220.driver import Keithley6220
from drivers.dialects.yokogawa_gs200.description import DESCRIPTION as GS200
from drivers.dialects.yokogawa_gs200.driver import YokogawaGS200
from drivers.kinds.ranges import SourceLimits
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.keithley_6220 import SimulatedKeithley
from simulators.instruments.sources.yokogawa_gs200 import SimulatedGS200
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"range": "20 mA", "compliance": "10 V", "terminator": "cr"}
GS200_OPTIONS = {"range": "10 mA", "compliance": "10 V"}
LIMITS = {"current": {"min": "-20 mA", "max": "20 mA"}}


class SourceRig:
    """A simulated source behind a tapped wire, and what drivers for it are made from."""

    def __init__(
        self, make: Callable[[World, FaultPlan], Any], description: DriverDescription, options: dict[str, Any],
        identity: IdentityPin, address: str, line: Line | None = None,
    ) -> None:  # fmt: skip
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.instrument = make(World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time), self.faults)
        self.wire = TappedWire(self.instrument, line)
        self._description, self._options, self._identity = description, options, identity
        self._address = Address.parse(address)
        self.notes: list[str] = []

    def driver(self, **options: Any) -> Any:
        setup = Setup(
            name="source", address=self._address, wires=self.wire,
            options=self._description.options.model_validate(self._options | options),
            limits=SourceLimits.model_validate(LIMITS), safe=Nothing(), identity=self._identity,
            note=self.notes.append,
        )  # fmt: skip
        return make_driver(self._description, setup)

    def commands(self) -> list[bytes]:
        """Received messages that are no queries."""
        heads = [line.partition(b";:SYST")[0].strip() for line in self.wire.requests]
        return [head for head in heads if b"?" not in head]


class Source6220(SourceRig):
    """A simulated source behind a tapped serial line."""

    def __init__(self, address: str = "serial:///dev/ttyUSB0?baud=19200", **settings: Any) -> None:
        pin = IdentityPin(model="MODEL 6220", serial="SIM-6220-01")
        settings = {"terminator": "cr", **settings}

        def make(world: World, faults: FaultPlan) -> SimulatedKeithley:
            return SimulatedKeithley(world, faults, **settings)

        super().__init__(make, DESCRIPTION, OPTIONS, pin, address, Line.serial(19200))


class SourceGS200(SourceRig):
    """A simulated source behind a tapped TCP connection."""

    def __init__(self, **settings: Any) -> None:
        pin = IdentityPin(model="GS210", serial="SIM-GS200-01")

        def make(world: World, faults: FaultPlan) -> SimulatedGS200:
            return SimulatedGS200(world, faults, **settings)

        super().__init__(make, GS200, GS200_OPTIONS, pin, "tcp://192.168.1.30:7655")


def with_source(use: Callable[[Source6220], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Source6220(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Source6220, Keithley6220], Awaitable[None]], **settings: Any) -> None:
    async def main(source: Source6220) -> None:
        async with source.driver() as driver:
            await use(source, driver)

    with_source(main, **settings)


def with_gs200(use: Callable[[SourceGS200, YokogawaGS200], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        source = SourceGS200(**settings)
        async with source.driver() as driver:
            await use(source, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def now_s() -> float:
    return asyncio.get_running_loop().time()
