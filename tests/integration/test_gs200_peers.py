"""GS200 drivers that other people wrote, PyMeasure's and QCoDeS's, use the simulated source over a TCP socket.

QCoDeS has no driver of a Keithley 6220 or 6221.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.yokogawa_gs200 import SimulatedGS200
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = pytest.mark.integration


def with_server(use: Callable[[str, SimulatedGS200], None]) -> None:
    """Runs `use` in a thread, with the VISA resource of a source and the source itself."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        source = SimulatedGS200(world, FaultPlan(now_s=loop.time))
        async with await loop.create_server(protocol_factory(source), "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            await asyncio.to_thread(use, f"TCPIP::127.0.0.1::{port}::SOCKET", source)

    run(main())


@pytest.mark.peer("pymeasure")
@pytest.mark.filterwarnings("ignore:It is not known whether this device:FutureWarning")  # asked of every GS200
def test_pymeasure_sets_and_reads_range_level_limit_and_output() -> None:
    def use(resource: str, source: SimulatedGS200) -> None:
        from pymeasure.adapters import VISAAdapter
        from pymeasure.instruments.yokogawa import YokogawaGS200

        adapter: Any = VISAAdapter(
            resource, visa_library="@py", timeout=2000, read_termination="\n", write_termination="\n"
        )
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
            gs200.trigger_ramp_to_level(0.002, 0.3)
            levels = [gs200.source_level]
            while levels[-1] != pytest.approx(0.002):
                levels.append(gs200.source_level)
            assert len(set(levels)) > 2
            assert levels == sorted(levels, reverse=True)
            gs200.source_level = 0.012
            gs200.write(":SOUR:LEV 0.0121")
            gs200.source_enabled = False
            assert [int(code) for code, *_ in gs200.check_errors()] == [-222]
            assert gs200.source_level == pytest.approx(0.012)
            assert source.current_a == 0
        finally:
            adapter.connection.close()
            adapter.manager.close()

    with_server(use)


@pytest.mark.peer("qcodes")
def test_qcodes_sets_and_reads_range_limit_level_and_output() -> None:
    def use(resource: str, source: SimulatedGS200) -> None:
        from qcodes.instrument_drivers.yokogawa import YokogawaGS200

        gs200: Any = YokogawaGS200("gs200", resource, visalib="@py", terminator="\n")
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
            gs200.ramp_mode("HARDWARE")
            gs200.ramp_rate(0.01)
            gs200.ramp_step(1e-6)
            gs200.ramp_blocking(True)
            gs200.current(0.004)
            assert source.current_a == pytest.approx(0.004)
            reported = gs200.snapshot(update=True)["parameters"]
            assert (reported["four_wire"]["value"], reported["line_freq"]["value"]) == ("off", 50)
            gs200.output("off")
            assert gs200.output() == "off"  # by when it has been read
            assert source.current_a == 0
            assert gs200.ask(":SYST:ERR?").startswith("0,")
        finally:
            gs200.close()

    with_server(use)
