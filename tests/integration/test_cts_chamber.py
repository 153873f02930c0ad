"""cts-chamber, which other people wrote for CTS chambers, uses the simulated one over a serial pty.

For SIMSERV no client was found that can be installed; pyVT4002 speaks another protocol of the same maker (ASCII-2).
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.cts import SimulatedCts
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.pty import serve_pty
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = [pytest.mark.integration, pytest.mark.peer("cts_chamber")]


def with_cts_chamber(use: Callable[[Any, SimulatedCts], None], path: Path) -> None:
    """Runs `use` in a thread, with the other people's driver on a chamber whose air is at 25 °C."""

    def connect(simulated: SimulatedCts) -> None:
        import pyvisa
        import pyvisa.constants
        from cts_chamber import CTSChamber

        class ThroughPty(CTSChamber):
            _RS232_PARITY = pyvisa.constants.Parity.none  # a pseudo-terminal cannot be set to parity

        manager = pyvisa.ResourceManager("@py")
        chamber = ThroughPty(serial_device=str(path), resource_manager=manager, communication_retries=0)
        try:
            use(chamber, simulated)
        finally:
            chamber.close()
            manager.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)), loop.time)
        simulated = SimulatedCts(world, FaultPlan(now_s=loop.time))
        async with serve_pty(path, protocol_factory(simulated)):
            await asyncio.to_thread(connect, simulated)

    run(main())


def test_it_ramps_and_reads_the_chamber(tmp_path: Path) -> None:
    def use(chamber: Any, simulated: SimulatedCts) -> None:
        assert chamber.get_temperature() == (25.0, 25.0)
        chamber.ramp_to_temperature(-40.0, ramp_up_rate=1.0, ramp_down_rate=0.5)
        ramp = chamber.get_temperature_ramp_information()
        assert (ramp.ramp_active, ramp.ramp_running) == (True, True)
        assert (ramp.ramp_rate_up, ramp.ramp_rate_down, ramp.ramp_target) == (1.0, 0.5, -40.0)
        assert chamber.get_temperature()[1] == pytest.approx(25.0, abs=0.1)
        chamber.set_temperature(30.0)
        assert simulated.set_point_c == 30.0

    with_cts_chamber(use, tmp_path / "chamber")


def test_it_starts_stops_and_pauses_the_chamber(tmp_path: Path) -> None:
    def use(chamber: Any, simulated: SimulatedCts) -> None:
        assert chamber.get_state().running
        chamber.pause()
        assert chamber.get_state().paused
        chamber.resume()
        assert not chamber.get_state().paused
        chamber.stop()
        assert not chamber.get_state().running
        chamber.start()
        state = chamber.get_state()
        assert (state.running, state.error) == (True, False)
        simulated.fail("2")
        state = chamber.get_state()
        assert (state.running, state.error) == (False, True)

    with_cts_chamber(use, tmp_path / "chamber")
