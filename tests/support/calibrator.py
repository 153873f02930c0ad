"""A simulated Fluke 5700A behind a tapped serial line, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.fluke_5700a.description import DESCRIPTION, FlukeOptions
from drivers.dialects.fluke_5700a.driver import Fluke5700A
from drivers.kinds.ranges import SourceLimits
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.fluke_5700a import SimulatedFluke
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"range": "22 mA", "compliance": "10 V"}
LIMITS = {"current": {"min": "-20 mA", "max": "20 mA"}}


class Calibrator:
    """A simulated calibrator behind a tapped serial line, and what drivers for it are made from."""

    def __init__(self, **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.instrument = SimulatedFluke(world, self.faults, **settings)
        self.wire = TappedWire(self.instrument, Line.serial(9600))

    def driver(self, **options: Any) -> Fluke5700A:
        setup = Setup(
            name="source", address=Address.parse("serial:///dev/ttyUSB0?baud=9600&flow=xonxoff"), wires=self.wire,
            options=FlukeOptions.model_validate(OPTIONS | options), limits=SourceLimits.model_validate(LIMITS),
            safe=Nothing(), identity=IdentityPin(serial="SIM-5720A-01"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, Fluke5700A)
        return driver

    def commands(self) -> list[bytes]:
        """Received messages that are no queries."""
        lines = [line for request in self.wire.requests for line in request.splitlines()]
        return [line for line in lines if b"?" not in line]

    def go_on(self) -> None:
        """Execute and answer the messages in the input buffer."""
        self.instrument.busy = False
        self.wire.connections[-1].data_received(b"")

    def at_the_panel(self, *commands: bytes) -> None:
        """Somebody sets it in local, or from another port."""
        remote, self.instrument.remote = self.instrument.remote, True
        for command in commands:
            self.instrument.execute(command.decode())
        self.instrument.remote = remote


def with_calibrator(use: Callable[[Calibrator], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Calibrator(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Calibrator, Fluke5700A], Awaitable[None]], **settings: Any) -> None:
    async def main(source: Calibrator) -> None:
        async with source.driver() as driver:
            await use(source, driver)

    with_calibrator(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
