"""A simulated indexing head behind a tapped wire, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.aerotech_ensemble.description import DESCRIPTION, EnsembleOptions
from drivers.aerotech_ensemble.driver import AerotechEnsemble
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.head.description import HeadLimits
from drivers.transport.address import Address
from simulators.aerotech_ensemble import SimulatedEnsemble
from simulators.faults import FaultPlan
from simulators.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"axis": "X", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
LIMITS = {"angle": {"min": "-5°", "max": "365°"}, "rate": {"max": "30 °/s"}}


class Head:
    """A simulated head behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.controller = SimulatedEnsemble(self.world, self.faults, **settings)
        self.wire = TappedWire(self.controller)

    def driver(self, **options: Any) -> AerotechEnsemble:
        setup = Setup(
            name="head", address=Address.parse("tcp://127.0.0.1:8000"), wires=self.wire,
            options=EnsembleOptions.model_validate(OPTIONS | options), limits=HeadLimits.model_validate(LIMITS),
            safe=Nothing(), identity=IdentityPin(serial="SIM-HEAD-01"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, AerotechEnsemble)
        return driver

    @property
    def angle_deg(self) -> float:
        return self.world.axis.encoder_deg(self.world.now())

    @property
    def moving(self) -> bool:
        return self.world.axis.moving(self.world.now())

    def moves(self) -> list[str]:
        return [line.decode().split()[2] for line in self.wire.requests if line.startswith(b"MOVEABS")]


def with_head(use: Callable[[Head], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Head(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Head, AerotechEnsemble], Awaitable[None]], **settings: Any) -> None:
    async def main(head: Head) -> None:
        async with head.driver() as driver:
            await use(head, driver)

    with_head(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
