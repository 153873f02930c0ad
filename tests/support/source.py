"""A simulated Keithley 6220 behind a tapped serial line, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.keithley_6220.description import DESCRIPTION, KeithleyOptions
from drivers.keithley_6220.driver import Keithley6220
from drivers.ranges import SourceLimits
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults import FaultPlan
from simulators.keithley_6220 import SimulatedKeithley
from simulators.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"range": "20 mA", "compliance": "10 V", "terminator": "cr"}
LIMITS = {"current": {"min": "-20 mA", "max": "20 mA"}}


class Source6220:
    """A simulated source behind a tapped serial line, and what drivers for it are made from."""

    def __init__(self, address: str = "serial:///dev/ttyUSB0?baud=19200", **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.instrument = SimulatedKeithley(world, self.faults, **{"terminator": "cr", **settings})
        self.wire = TappedWire(self.instrument, Line.serial(19200))
        self._address = Address.parse(address)

    def driver(self, **options: Any) -> Keithley6220:
        setup = Setup(
            name="source", address=self._address, wires=self.wire,
            options=KeithleyOptions.model_validate(OPTIONS | options), limits=SourceLimits.model_validate(LIMITS),
            safe=Nothing(), identity=IdentityPin(model="MODEL 6220", serial="SIM-6220-01"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, Keithley6220)
        return driver

    def commands(self) -> list[bytes]:
        """What was sent that is no question."""
        heads = [line.partition(b";:SYST")[0].strip() for line in self.wire.requests]
        return [head for head in heads if b"?" not in head]


def with_source(use: Callable[[Source6220], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Source6220(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Source6220, Keithley6220], Awaitable[None]], **settings: Any) -> None:
    async def main(source: Source6220) -> None:
        async with source.driver() as driver:
            await use(source, driver)

    with_source(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
