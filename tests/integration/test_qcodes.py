"""QCoDeS's GS200 driver, which other people wrote, uses the simulated source over a TCP socket.

QCoDeS has no driver of a Keithley 6220 or 6221.
"""

import asyncio
from typing import Any

import pytest

from bench.loop import run
from simulators.faults import FaultPlan
from simulators.serve import protocol_factory
from simulators.settings import WorldSettings
from simulators.world import World
from simulators.yokogawa_gs200 import SimulatedGS200

pytestmark = [pytest.mark.integration, pytest.mark.peer("qcodes")]


def test_it_sets_and_reads_range_limit_level_and_output() -> None:
    def use(port: int, source: SimulatedGS200) -> None:
        from qcodes.instrument_drivers.yokogawa import YokogawaGS200

        gs200: Any = YokogawaGS200("gs200", f"TCPIP::127.0.0.1::{port}::SOCKET", visalib="@py", terminator="\n")
        try:
            assert gs200.get_idn()["serial"] == "SIM-GS200-01"
            assert gs200.output() == "off"
            gs200.source_mode("CURR")
            gs200.current_range(0.01)
            gs200.voltage_limit(5)
            gs200.output("on")
            gs200.current(0.002)
            assert gs200.current() == pytest.approx(0.002)
            assert gs200.current_range() == pytest.approx(0.01)
            assert gs200.voltage_limit() == 5
            assert source.current_a == pytest.approx(0.002)
            gs200.output("off")
            assert source.current_a == 0
            assert gs200.ask(":SYST:ERR?").startswith("0,")
        finally:
            gs200.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        source = SimulatedGS200(world, FaultPlan(now_s=loop.time))
        async with await loop.create_server(protocol_factory(source), "127.0.0.1", 0) as server:
            await asyncio.to_thread(use, server.sockets[0].getsockname()[1], source)

    run(main())
