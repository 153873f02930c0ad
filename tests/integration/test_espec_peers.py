"""Programs that other people wrote for ESPEC chambers use the simulated P300 over TCP.

espec-pr3j is whole. chamberconnectlibrary, of the maker's American branch, is for Python 2: its module p300, which
spells the commands and reads the answers, runs on Python 3 as well; the few lines of its module especinteract that move
the bytes do not, since they join text and bytes, and are replaced here.
"""

import asyncio
import importlib
import socket
import sys
from collections.abc import Callable
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.espec_p300 import SimulatedP300
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = pytest.mark.integration


def with_server(use: Callable[[int, SimulatedP300], None]) -> None:
    """Runs `use` in a thread, with the port of a chamber whose air is at 25 °C."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)), loop.time)
        p300 = SimulatedP300(world, FaultPlan(now_s=loop.time), humidity_percent=45)
        server = await loop.create_server(protocol_factory(p300), "127.0.0.1", 0)
        try:
            await asyncio.to_thread(use, server.sockets[0].getsockname()[1], p300)
        finally:
            server.close()
            await server.wait_closed()

    run(main())


@pytest.mark.peer("espec_pr3j")
def test_espec_pr3j_sets_and_reads_the_chamber() -> None:
    def use(port: int, p300: SimulatedP300) -> None:
        import pyvisa
        from espec_pr3j import EspecPr3j, OperationMode, SettingError

        manager = pyvisa.ResourceManager("@py")
        chamber = EspecPr3j(resource_path=f"TCPIP0::127.0.0.1::{port}::SOCKET", resource_manager=manager)
        try:
            chamber.set_mode(OperationMode.STANDBY)
            assert chamber.get_mode() == OperationMode.STANDBY
            chamber.set_temperature_limits(upper_limit=80.0, lower_limit=5.0)
            chamber.set_constant_condition(25.2, stable_time=0.1, poll_interval=0.1)
            status = chamber.get_temperature_status()
            assert status.current_temperature == pytest.approx(25.0, abs=0.3)
            assert (status.target_temperature, status.upper_limit, status.lower_limit) == (25.2, 80.0, 5.0)
            state = chamber.get_test_area_state()
            assert (state.operation_state, state.current_humidity, state.number_of_alarms) == (
                OperationMode.CONSTANT, 45.0, 0,
            )  # fmt: skip
            with pytest.raises(SettingError):
                chamber.set_target_temperature(80.1)
            assert p300.set_point_c == 25.2
        finally:
            chamber.close()
            manager.close()

    with_server(use)


class Wire:
    """What especinteract does, for Python 3: a line there, and the line that comes back."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=5)
        self._lines = self._socket.makefile("rb")

    def interact(self, message: str) -> str:
        self._socket.sendall(message.encode() + b"\r\n")
        answer = self._lines.readline().decode()
        assert answer.endswith("\r\n")
        if answer.startswith("NA:"):
            raise RuntimeError(answer.strip())
        return answer[:-2]

    def close(self) -> None:
        self._lines.close()
        self._socket.close()


def vendors_p300(port: int, monkeypatch: pytest.MonkeyPatch) -> Any:
    found = find_spec("chamberconnectlibrary")
    assert found is not None
    assert found.origin is not None
    monkeypatch.syspath_prepend(str(Path(found.origin).parent))  # its modules find each other only from there
    for module in ("p300", "especinteract"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    kind = importlib.import_module("p300").P300
    p300 = kind.__new__(kind)
    p300.ramprgms, p300.ctlr = 40, Wire(port)
    return p300


@pytest.mark.peer("chamberconnectlibrary")
@pytest.mark.filterwarnings("ignore::SyntaxWarning", "ignore::DeprecationWarning")
def test_the_makers_library_sets_and_reads_the_chamber(monkeypatch: pytest.MonkeyPatch) -> None:
    def use(port: int, simulated: SimulatedP300) -> None:
        with closing(vendors_p300(port, monkeypatch)) as p300:
            assert p300.read_rom() == "P300 1.04"
            assert p300.read_type() == {"drybulb": "T", "wetbulb": "T", "controller": "S2", "tempmax": 180.0}
            p300.write_temp(setpoint=30.0, max=90.0, min=-20.0)
            temperature = p300.read_temp()
            assert temperature["setpoint"] == simulated.set_point_c == 30.0
            assert temperature["range"] == {"max": 90.0, "min": -20.0}
            p300.write_mode_off()
            assert p300.read_mode() == "OFF"
            p300.write_power(True)
            p300.write_mode_constant()
            assert p300.read_mon() == {
                "temperature": temperature["processvalue"], "humidity": 45.0, "mode": "CONSTANT", "alarms": 0,
            }  # fmt: skip
            p300.write_prgm_run(1, 1)
            assert p300.read_mode() == "RUN"
            p300.write_prgm_end("STANDBY")
            simulated.alarm(7)
            assert p300.read_alarm() == [7]
            assert p300.read_mode() == "STANDBY"
            with pytest.raises(RuntimeError, match="NA:DATA OUT OF RANGE"):
                p300.write_temp(setpoint=90.1)
            with pytest.raises(RuntimeError, match="NA:CHB NOT READY"):
                p300.write_mode_constant()

    with_server(use)
