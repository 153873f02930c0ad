"""A simulated supply with a unit on it behind a tapped wire, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from bench.config.load import load_file
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.scpi_supply.description import DESCRIPTION, SupplyLimits, SupplyOptions
from drivers.dialects.scpi_supply.driver import ScpiSupply
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.scpi_supply import SimulatedSupply
from simulators.units.settings import PlaceSettings, WorldSettings
from simulators.units.unit_file import UnitFile
from simulators.world import World
from tests.support.lines import TappedWire

UNIT = load_file(Path(__file__).parents[2] / "config" / "uut" / "quartz_flexure.yaml", UnitFile)
LIMITS = {"voltage": {"max": "16 V"}, "current": {"max": "200 mA"}}


class Supply:
    """A simulated supply with a unit on it behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, address: str = "tcp://127.0.0.1:5025", line: Line | None = None) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        places = {"a": PlaceSettings(unit=UNIT, channel="x", supply="supply")}
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8, places=places), loop.time)
        self.instrument = SimulatedSupply(self.world, self.faults)
        self.wire = TappedWire(self.instrument, line)
        self._address = Address.parse(address)
        self.notes: list[str] = []

    def driver(self, *, answers: tuple[str, ...] = (), watchdog: str | None = None, **pin: str) -> ScpiSupply:
        options = SupplyOptions.model_validate({"answers": answers, "watchdog": watchdog})
        setup = Setup(
            name="supply", address=self._address, wires=self.wire, options=options,
            limits=SupplyLimits.model_validate(LIMITS), safe=Nothing(),
            identity=IdentityPin.model_validate({"model": "SIM-PSU", "serial": "SIM-PSU-01"} | pin),
            note=self.notes.append,
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, ScpiSupply)
        return driver

    @property
    def unit_powered(self) -> bool:
        return self.world.units["a"].powered_at_s is not None

    @property
    def load_a(self) -> float:
        return self.world.units["a"].truth.supply_a

    def commands(self) -> list[bytes]:
        """Received messages that are no queries."""
        return [line.partition(b";")[0].strip() for line in self.wire.requests if b"?" not in line.partition(b";")[0]]


def with_supply(use: Callable[[Supply], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Supply(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Supply, ScpiSupply], Awaitable[None]], **settings: Any) -> None:
    async def main(supply: Supply) -> None:
        async with supply.driver() as driver:
            await use(supply, driver)

    with_supply(main, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
