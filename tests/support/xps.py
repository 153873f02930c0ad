"""A simulated XPS with a head behind a tapped wire, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.head.description import HeadLimits
from drivers.newport_xps.description import DESCRIPTION, XpsOptions
from drivers.newport_xps.driver import NewportXps
from drivers.transport.address import Address
from simulators.faults import FaultPlan
from simulators.newport_xps import SimulatedXps
from simulators.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"group": "HEAD", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
LIMITS = {"angle": {"min": "-5°", "max": "365°"}, "rate": {"max": "90 °/s"}}


class XpsHead:
    """A simulated head behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.controller = SimulatedXps(self.world, self.faults, **settings)
        self.wire = TappedWire(self.controller)

    def driver(self, **options: Any) -> NewportXps:
        setup = Setup(
            name="head", address=Address.parse("tcp://127.0.0.1:5001"), wires=self.wire,
            options=XpsOptions.model_validate(OPTIONS | options), limits=HeadLimits.model_validate(LIMITS),
            safe=Nothing(), identity=IdentityPin(serial="SIM-HEAD-02"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, NewportXps)
        return driver

    def call(self, text: str) -> str:
        """Another program's call, on a connection of its own."""
        return self.controller.session().feed(text.encode()).decode()

    @property
    def angle_deg(self) -> float:
        return self.world.axis.encoder_deg(self.world.now())

    @property
    def moving(self) -> bool:
        return self.world.axis.moving(self.world.now())

    def moves(self) -> list[str]:
        calls = [call.decode() for call in self.wire.requests if call.startswith(b"GroupMoveAbsolute")]
        return [call.removesuffix(")").split(",")[1] for call in calls]


def with_xps(use: Callable[[XpsHead], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(XpsHead(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_xps_driver(use: Callable[[XpsHead, NewportXps], Awaitable[None]], **settings: Any) -> None:
    async def main(head: XpsHead) -> None:
        async with head.driver() as driver:
            await use(head, driver)

    with_xps(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
