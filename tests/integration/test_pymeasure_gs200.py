"""PyMeasure's GS200 driver, which other people wrote, uses the simulated source over a TCP socket."""

import asyncio
from typing import Any

import pytest

from bench.loop import run
from simulators.faults import FaultPlan
from simulators.serve import protocol_factory
from simulators.settings import WorldSettings
from simulators.world import World
from simulators.yokogawa_gs200 import SimulatedGS200

pytestmark = [
    pytest.mark.integration,
    pytest.mark.peer("pymeasure"),
    pytest.mark.filterwarnings("ignore:It is not known whether this device:FutureWarning"),  # asked of every GS200
]


def test_it_sets_and_reads_range_level_limit_and_output() -> None:
    def use(port: int, source: SimulatedGS200) -> None:
        from pymeasure.adapters import VISAAdapter
        from pymeasure.instruments.yokogawa import YokogawaGS200

        adapter: Any = VISAAdapter(
            f"TCPIP::127.0.0.1::{port}::SOCKET", visa_library="@py", timeout=2000,
            read_termination="\n", write_termination="\n",
        )  # fmt: skip
        try:
            gs200 = YokogawaGS200(adapter)
            assert gs200.id == "YOKOGAWA,GS210,SIM-GS200-01,2.02"
            gs200.source_mode = "current"
            gs200.source_range = 0.01
            gs200.voltage_limit = 5
            gs200.source_level = 0.012
            gs200.source_enabled = True
            assert gs200.source_mode == "CURR"
            assert gs200.source_range == pytest.approx(0.01)
            assert gs200.voltage_limit == 5
            assert gs200.source_level == pytest.approx(0.012)
            assert gs200.source_enabled is True
            assert source.current_a == pytest.approx(0.012)
            assert gs200.check_errors() == []
            gs200.write(":SOUR:LEV 0.0121")
            gs200.source_enabled = False
            assert [int(code) for code, *_ in gs200.check_errors()] == [-222]
            assert gs200.source_level == pytest.approx(0.012)
            assert source.current_a == 0
        finally:
            adapter.connection.close()
            adapter.manager.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        source = SimulatedGS200(world, FaultPlan(now_s=loop.time))
        async with await loop.create_server(protocol_factory(source), "127.0.0.1", 0) as server:
            await asyncio.to_thread(use, server.sockets[0].getsockname()[1], source)

    run(main())
