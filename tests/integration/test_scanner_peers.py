"""Scanner programs that other people wrote, dvg-devices and daqmon, use the simulated scanner."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.agilent_34970a import SimulatedScanner
from simulators.serving.pty import serve_pty
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = pytest.mark.integration


def a_scanner(**settings: Any) -> SimulatedScanner:
    """With sensors in the air, which is at 20 °C, on the channels 101 and 103."""
    now_s = asyncio.get_running_loop().time
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), now_s)
    return SimulatedScanner(world, FaultPlan(now_s=now_s), {101: "wall", 103: "air"}, **settings)


@pytest.mark.peer("dvg_devices")
def test_dvg_devices_looks_at_the_cards_sets_a_scan_up_and_fetches_it() -> None:
    def use(port: int) -> None:
        import pyvisa
        from dvg_devices.Keysight_3497xA_protocol_SCPI import Keysight_3497xA

        manager: Any = pyvisa.ResourceManager("@py")
        mux = Keysight_3497xA(f"TCPIP::127.0.0.1::{port}::SOCKET")
        try:
            assert mux.connect(manager)
            channels = "(@101,103)"
            setup = [
                f"rout:open {channels}", f"conf:temp TC,J,{channels}", f"unit:temp C,{channels}",
                f"sens:temp:tran:tc:rjun:type INT,{channels}", f"sens:temp:tran:tc:check ON,{channels}",
                f"sens:temp:nplc 1,{channels}", f"rout:scan {channels}",
            ]  # fmt: skip
            assert mux.begin(setup)
            assert mux.state.all_errors == []
            assert (mux.diag.slot_1_ctype.split(",")[1], mux.diag.slot_2_ctype) == ("34901A", "none")
            assert mux.state.all_scan_list_channels == ["101", "103"]
            mux.init_scan()
            mux.wait_for_OPC()
            assert mux.fetch_scan()
            assert mux.state.readings == pytest.approx([20, 20], abs=1)
            mux.write("conf:temp TC,X,(@101)")
            mux.query_all_errors_in_queue()
            assert mux.state.all_errors == ['-224,"Illegal parameter value"']
        finally:
            mux.close()
            manager.close()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with await loop.create_server(protocol_factory(a_scanner()), "127.0.0.1", 0) as server:
            await asyncio.to_thread(use, server.sockets[0].getsockname()[1])

    run(main())


@pytest.mark.peer("daqmon")
def test_daqmon_scans_by_the_timer_and_takes_the_readings_out_of_memory(tmp_path: Path) -> None:
    def use(path: Path) -> None:
        from daqmon.instrument import HP34970A

        scanner = HP34970A(str(path), timeout=2)
        scanner.open()
        try:
            assert scanner.idn() == "HEWLETT-PACKARD,34970A,0,13-2-2"
            scanner.clear_status()
            scanner.configure_thermocouple([101, 103], tc_type="K")
            scanner.set_channel_delay(101, 0.5)
            scanner.set_scan_list([101, 103])
            scanner.set_scan_interval(0.5)
            scanner.set_scan_count(0)
            scanner.enable_channel_in_readings()
            assert scanner.get_scan_channel_list() == "#210(@101,103)"
            assert (scanner.query_tc_type(101), scanner.query_tc_rjunction(103)) == ("K", "INT")
            assert (scanner.query_channel_function(101), scanner.query_channel_delay(101)) == (
                '"TEMP"',
                "+5.00000000E-01",
            )
            assert (scanner.query_trigger_source(), scanner.query_trigger_count()) == ("TIM", "+9.90000000E+37")
            scanner.initiate_scan()
            until(lambda: scanner.get_data_count() >= 3)
            taken = scanner.query_readings_with_channels("DATA:REM? 3")
            assert [channel for _, channel in taken] == [101, 103, 101]
            assert [value for value, _ in taken] == pytest.approx([20, 20, 20], abs=1)
            scanner.abort_scan()
            assert scanner.query("SYST:ERR?") == '+0,"No error"'
        finally:
            scanner.close()

    async def main() -> None:
        path = tmp_path / "scanner"
        async with serve_pty(path, protocol_factory(a_scanner(answer_end=b"\r\n"))):
            await asyncio.to_thread(use, path)

    run(main())


def until(there: Callable[[], bool]) -> None:
    """Looks until it is so; the scan takes its time."""
    while not there():
        pass
