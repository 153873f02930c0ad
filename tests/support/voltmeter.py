"""A simulated 3458A across a load with a perfect unit on it, behind a tapped wire, and what drivers are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.keysight_3458a.description import DESCRIPTION, VoltmeterOptions
from drivers.dialects.keysight_3458a.driver import Keysight3458A
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.keysight_3458a import Simulated3458A
from simulators.instruments.meters.meter_inputs import VoltsOnLoad
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.laboratory import STILL_AIR, place
from tests.support.lines import TappedWire
from tests.support.planar import planar

LOAD_OHM = 500.0  # with 1 mA/g: 0.5 V per g
CYCLE_S = 0.02


def a_world(now_s: Callable[[], float]) -> World:
    """A powered unit of 1 mA/g, its axis up at a head angle of 0°."""
    settings = WorldSettings(
        seed=1, gravity_mps2=9.8, fixture=planar(1, 90.0), chamber=STILL_AIR, places={"a": place()}
    )
    world = World(settings, now_s)
    world.power("supply", True)
    return world


class Meter:
    """A simulated voltmeter behind a tapped wire."""

    def __init__(self, *, line_hz: float = 50.0, identity: str = "HP3458A", **errors: float) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.world = a_world(loop.time)
        on_load = VoltsOnLoad(self.world, VoltmeterSettings("a", LOAD_OHM, **errors), "voltmeter")
        self.instrument = Simulated3458A(self.world, self.faults, on_load, line_hz=line_hz, identity=identity)
        self.wire = TappedWire(self.instrument)

    def driver(self, *, pin: dict[str, str] | None = None, **options: Any) -> Keysight3458A:
        setup = Setup(
            name="dvm", address=Address.parse("tcp://127.0.0.1:1234"), wires=self.wire,
            options=VoltmeterOptions.model_validate({"range": "1 V"} | options), limits=Nothing(), safe=Nothing(),
            identity=IdentityPin.model_validate({"model": "3458A", "serial": "US28031234"} | (pin or {})),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, Keysight3458A)
        return driver


def with_meter(use: Callable[[Meter], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Meter(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Meter, Keysight3458A], Awaitable[None]], **settings: Any) -> None:
    async def main(meter: Meter) -> None:
        async with meter.driver() as driver:
            await use(meter, driver)

    with_meter(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
