"""The drivers of chambers that speak in text over real sockets and pseudo-terminals, in real time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from bench.loop import run
from drivers.description import IdentityPin, Setup, known_drivers, make_driver
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.transport.address import Address
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.pty import serve_pty
from simulators.serving.serve import Instrument, protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.chambers import LIMITS

pytestmark = pytest.mark.integration


@asynccontextmanager
async def served(instrument: Instrument, address: str, folder: Path) -> AsyncIterator[Address]:
    """The instrument at an address of this machine that looks like the given one."""
    factory = protocol_factory(instrument)
    if address.startswith("serial:"):
        async with serve_pty(folder / "port", factory) as path:
            yield Address.parse(address.replace("PORT", str(path)))
        return
    server = await asyncio.get_running_loop().create_server(factory, "127.0.0.1", 0)
    try:
        yield Address.parse(address.replace("PORT", str(server.sockets[0].getsockname()[1])))
    finally:
        server.close()
        await server.wait_closed()


@pytest.mark.parametrize(
    ("name", "address"),
    [
        ("espec_p300", "serial://PORT?baud=9600"),
        ("simserv", "tcp://127.0.0.1:PORT"),
        ("cts", "serial://PORT?baud=19200&parity=O"),
    ],
)
def test_a_chamber_is_ramped_held_and_made_safe(name: str, address: str, tmp_path: Path) -> None:
    async def main() -> None:
        description = known_drivers()[name]
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=25.0)), loop.time)
        options = description.options.model_validate({"poll": "200 ms"})
        setup = InstrumentSetup("chamber", world, FaultPlan(now_s=loop.time), options)
        async with served(make_instrument(description.simulator, setup), address, tmp_path) as where:
            driver = make_driver(
                description,
                Setup(
                    "chamber", where, RealWires(), options, ChamberLimits.model_validate(LIMITS), ChamberSafe(),
                    IdentityPin(),
                ),
            )  # fmt: skip
            assert isinstance(driver, Chamber)
            async with driver:
                await driver.ramp_to(25.1, 3.0)
                await driver.hold()
                assert (await driver.state()).set_point_c == 25.1
                await driver.make_safe()
                assert (await driver.state()).target_c == 25.0

    run(main())
