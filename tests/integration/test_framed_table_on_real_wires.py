"""The driver of a described rate table over real sockets and a pseudo-terminal, in real time."""

import asyncio
from pathlib import Path

import pytest

from bench.loop import run
from drivers.description import IdentityPin, Nothing, Setup
from drivers.dialects.framed.axes import FramedTable
from drivers.dialects.framed.description import FramedTableOptions
from drivers.dialects.framed.profile import FrameProfile
from drivers.kinds.table.description import TableLimits
from drivers.schema.fields import DocumentFile
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.framed import SimulatedFrames
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.integration.test_chambers_on_real_wires import served
from tests.support.framed import FICTIONAL, OPTIONS, PLAIN
from tests.support.table import LIMITS

pytestmark = pytest.mark.integration


@pytest.mark.parametrize(
    ("profile", "address"),
    [(FICTIONAL, "tcp://127.0.0.1:PORT"), (PLAIN, "serial://PORT?baud=115200")],
)
def test_a_table_turns_is_stopped_and_made_safe(profile: FrameProfile, address: str, tmp_path: Path) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        controller = SimulatedFrames(world, FaultPlan(now_s=loop.time), profile)
        controller.enabled = True
        options = FramedTableOptions.model_validate(OPTIONS | {"profile": DocumentFile(Path("made up"), profile)})
        async with served(controller, address, tmp_path) as where:
            controller.carry_out("rate", turning(profile))
            await asyncio.sleep(0.5)
            setup = Setup(
                "table", where, RealWires(), options, TableLimits.model_validate(LIMITS), Nothing(), IdentityPin()
            )
            async with FramedTable(setup) as driver:
                assert (await driver.rate()).value == pytest.approx(5)
                await driver.rotate_at(30, acceleration_dps2=None)
                assert (await driver.rate()).value == pytest.approx(30)
                await driver.stop()
                await driver.make_safe()
                assert not world.axis.moving(world.now())

    run(main())


def turning(profile: FrameProfile) -> bytes:
    """What somebody else sends: 5 °/s."""
    assert profile.commands.rate is not None
    form = profile.number(profile.commands.rate.rate)
    return profile.format("rate").build([(form, form.raw(5.0))])
