"""PyMeasure's Keithley 6221 driver, which other people wrote, uses the simulated source over a serial pty."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.keithley_6220 import SimulatedKeithley
from simulators.serving.pty import serve_pty
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = [pytest.mark.integration, pytest.mark.peer("pymeasure")]


def with_pymeasure(use: Callable[[Any, SimulatedKeithley], None], path: Path, *, model: str = "6220") -> None:
    """Runs `use` in a thread, with PyMeasure's driver on a source that this loop serves."""

    def connect(source: SimulatedKeithley) -> None:
        from pymeasure.adapters import VISAAdapter
        from pymeasure.instruments.keithley import Keithley6221

        adapter = VISAAdapter(
            f"ASRL{path}::INSTR", visa_library="@py", baud_rate=19200, timeout=2000,
            read_termination="\r", write_termination="\r",
        )  # fmt: skip
        try:
            use(Keithley6221(adapter), source)
        finally:
            adapter.connection.close()
            adapter.manager.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        source = SimulatedKeithley(world, FaultPlan(now_s=loop.time), model=model)
        async with serve_pty(path, protocol_factory(source)):
            await asyncio.to_thread(connect, source)

    run(main())


def test_it_sets_and_reads_current_compliance_and_output(tmp_path: Path) -> None:
    def use(keithley: Any, source: SimulatedKeithley) -> None:
        assert keithley.id == "KEITHLEY INSTRUMENTS INC.,MODEL 6220,SIM-6220-01,D04  /700x"
        keithley.source_range = 0.02
        keithley.source_compliance = 5
        keithley.source_current = 0.0012
        keithley.enable_source()
        assert keithley.source_range == pytest.approx(0.02)
        assert not keithley.source_auto_range
        assert keithley.source_compliance == pytest.approx(5)
        assert keithley.source_current == pytest.approx(0.0012)
        assert keithley.source_enabled is True
        assert source.current_a == pytest.approx(0.0012)
        keithley.source_enabled = False
        assert keithley.source_enabled is False
        assert source.current_a == 0
        assert keithley.complete == "1"
        assert keithley.check_errors() == []

    with_pymeasure(use, tmp_path / "source")


def test_it_reads_the_errors_and_resets(tmp_path: Path) -> None:
    def use(keithley: Any, source: SimulatedKeithley) -> None:
        keithley.source_range = 0.002
        keithley.source_current = 0.01
        keithley.write("NONSENSE")
        codes = [int(code) for code, *_ in keithley.check_errors()]
        assert codes == [-222, -113]
        keithley.write("NONSENSE")
        keithley.reset()
        assert keithley.check_errors() == []
        assert keithley.source_auto_range
        keithley.shutdown()
        assert not source.output

    with_pymeasure(use, tmp_path / "source")


def test_it_makes_a_wave_and_sees_its_end(tmp_path: Path) -> None:
    def use(keithley: Any, source: SimulatedKeithley) -> None:
        keithley.shield_to_guard_enabled = True
        keithley.output_low_grounded = True
        assert keithley.shield_to_guard_enabled is True
        assert keithley.output_low_grounded is True
        keithley.waveform_function = "square"
        keithley.waveform_amplitude = 0.01
        keithley.waveform_offset = 0.002
        keithley.waveform_frequency = 1000
        keithley.waveform_duration_cycles = 100
        keithley.waveform_use_phasemarker = True
        assert (keithley.waveform_function, keithley.waveform_use_phasemarker) == ("square", True)
        assert (keithley.waveform_amplitude, keithley.waveform_offset) == pytest.approx((0.01, 0.002))
        keithley.operation_event_enabled = 128
        keithley.srq_event_enabled = 128
        keithley.waveform_arm()
        keithley.waveform_start()
        while not int(keithley.status) & 128:
            assert source.current_a in (0.002, 0.0)
        assert keithley.operation_events == 128 | 16
        assert keithley.source_enabled is False
        keithley.waveform_abort()
        assert keithley.check_errors() == []

    with_pymeasure(use, tmp_path / "source", model="6221")
