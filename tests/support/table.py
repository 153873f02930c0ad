"""A simulated rate table behind a tapped wire, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.acutronic_acl.axis import AcutronicAcl
from drivers.dialects.acutronic_acl.description import DESCRIPTION, AclOptions
from drivers.kinds.table.description import TableLimits
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.acutronic_acl import SimulatedAcutrol
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {
    "axis": 1, "rate": "100 °/s", "acceleration": "200 °/s²", "settle": {"band": "1 arcsec", "hold": "1 s"},
}  # fmt: skip
LIMITS = {"rate": {"max": "400 °/s"}, "acceleration": {"max": "4200 °/s²"}, "frequency": {"max": "25 Hz"}}
WITH_ENDS = LIMITS | {"angle": {"min": "-170°", "max": "170°"}}


def framed(text: bytes, code: int = 0) -> bytes:
    """An answer as the controller frames it: error code, length, text; both numbers little-endian."""
    return code.to_bytes(4, "little", signed=True) + len(text).to_bytes(4, "little") + text


class Turned:
    """What is in front of the axis of a world."""

    world: World

    @property
    def angle_deg(self) -> float:
        """Angle over whole turns."""
        return self.world.axis.encoder_deg(self.world.now())

    @property
    def rate_dps(self) -> float:
        return self.world.axis.rate_dps(self.world.now())

    @property
    def moving(self) -> bool:
        return self.world.axis.moving(self.world.now())


class Table(Turned):
    """A simulated table behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, limits: Any = LIMITS, **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.limits = limits
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.controller = SimulatedAcutrol(self.world, self.faults, **settings)
        self.wire = TappedWire(self.controller)

    def driver(self, pin: IdentityPin | None = None, **options: Any) -> AcutronicAcl:
        setup = Setup(
            name="table", address=Address.parse("tcp://127.0.0.1:9878"), wires=self.wire,
            options=AclOptions.model_validate(OPTIONS | options), limits=TableLimits.model_validate(self.limits),
            safe=Nothing(), identity=pin or IdentityPin(model="Acutrol3000"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, AcutronicAcl)
        return driver

    def commands(self, *words: str) -> list[str]:
        """Received messages that begin with one of the words, in order; without words all that are no queries."""
        lines = [line.decode().strip() for line in self.wire.requests]
        return [line for line in lines if (line.startswith(words) if words else "?" not in line)]

    def demand_elsewhere(self, *messages: str) -> None:
        """Somebody else commands the controller, over another interface."""
        for message in messages:
            assert self.controller.execute(message).code == 0, message


def with_table(use: Callable[[Table], Awaitable[None]], limits: Any = LIMITS, **settings: Any) -> None:
    async def main() -> None:
        await use(Table(limits, **settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(
    use: Callable[[Table, AcutronicAcl], Awaitable[None]], limits: Any = LIMITS, **settings: Any
) -> None:  # fmt: skip
    async def main(table: Table) -> None:
        async with table.driver() as driver:
            await use(table, driver)

    with_table(main, limits, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
