"""chamberconnectlibrary, of a maker of chambers with Watlow controllers, on our simulated F4 and F4T.

It is for Python 2. lib2to3, which comes with Python up to 3.12, makes Python 3 of the modules that spell the registers
and of the one that makes Modbus frames; there the few places are mended where bytes were text.
"""

from __future__ import annotations

import asyncio
import importlib
import re
import sys
import types
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4 import SimulatedF4
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.pty import serve_pty
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = [
    pytest.mark.integration,
    pytest.mark.peer("chamberconnectlibrary"),
    pytest.mark.filterwarnings("ignore:lib2to3:DeprecationWarning", "ignore::SyntaxWarning"),
]
PACKAGE = "chamberconnectlibrary"
BYTES_WERE_TEXT = [  # in its module modbus
    (r"struct\.unpack\((['\"])>B\1, (\w+\[\d\])\)\[0\]", r"\2"), (r"\bord\(i\)", "i"), (r"(cnt = .+)/2", r"\1//2"),
    (r"^import collections$", "import collections.abc as collections"),
]  # fmt: skip


@pytest.fixture(scope="module")
def library() -> Any:
    """Its modules modbus, watlowf4 and watlowf4t, as a namespace; made of the installed files, which stay."""
    refactor = pytest.importorskip("lib2to3.refactor", reason="Python 3.13 has no lib2to3")
    found = find_spec(PACKAGE)
    assert found is not None
    assert found.origin is not None
    fixers = refactor.get_fixers_from_package("lib2to3.fixes")
    wanted = ("basestring", "except", "long", "metaclass", "print", "unicode", "xrange", "isinstance")
    tool = refactor.RefactoringTool([each for each in fixers if each.rpartition("fix_")[2] in wanted])
    made: dict[str, types.ModuleType] = {}
    before = {name: module for name, module in sys.modules.items() if name.startswith(PACKAGE)}
    try:
        for name in ("modbus", "controllerinterface", "watlowf4", "watlowf4t"):
            text = (Path(found.origin).parent / f"{name}.py").read_text("utf-8-sig")
            text = str(tool.refactor_string(text + "\n", name))
            for old, new in BYTES_WERE_TEXT if name == "modbus" else ():
                text, count = re.subn(old, new, text, flags=re.MULTILINE)
                assert count, old
            made[name] = sys.modules[f"{PACKAGE}.{name}"] = types.ModuleType(f"{PACKAGE}.{name}")
            exec(compile(text, name, "exec"), made[name].__dict__)
    finally:
        for name in made:
            del sys.modules[f"{PACKAGE}.{name}"]
        sys.modules.update(before)
        importlib.invalidate_caches()
    return types.SimpleNamespace(**made)


def with_chamber(use: Callable[[Any, World], None], library: Any, kind: str, line: Path | None) -> None:
    """Runs `use` in a thread, with the library's controller on a chamber whose air is at 25 °C; TCP without a line."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)), loop.time)
        faults = FaultPlan(now_s=loop.time)
        controller = library.watlowf4.WatlowF4 if kind == "f4" else library.watlowf4t.WatlowF4T
        chamber = SimulatedF4(world, faults) if kind == "f4" else SimulatedF4T(world, faults, serial_line=bool(line))
        if line is not None:
            async with serve_pty(line, protocol_factory(chamber)):
                peer = controller(interface="RTU", adr=1, serialport=str(line), baudrate=9600)
                await asyncio.to_thread(use, peer, world)
            return
        async with await loop.create_server(protocol_factory(chamber), "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            library.watlowf4t.ModbusTCP = lambda address, host: library.modbus.ModbusTCP(address, host, port)
            await asyncio.to_thread(use, controller(interface="TCP", adr=1, host="127.0.0.1"), world)

    run(main())


@pytest.mark.parametrize(("kind", "on_a_line"), [("f4t", False), ("f4t", True), ("f4", True)])
def test_it_reads_and_sets_the_loop(library: Any, kind: str, on_a_line: bool, tmp_path: Path) -> None:
    def use(peer: Any, world: World) -> None:
        assert peer.get_loop_pv(1) == {"air": pytest.approx(25.0)}
        assert peer.get_loop_sp(1) == {"constant": 25.0, "current": 25.0}
        peer.set_loop_sp(1, {"constant": -40.5})
        assert peer.get_loop_sp(1)["constant"] == -40.5
        assert world.thermal.set_point_c == -40.5
        assert peer.get_loop_range(1)["min"] <= -40.5
        assert kind == "f4t" or peer.get_loop_units(1) == "°C"  # of an F4T it asks for those of a profile
        with pytest.raises(library.modbus.ModbusError):
            peer.set_loop_sp(1, {"constant": 500.0})
        assert world.thermal.set_point_c == -40.5

    with_chamber(use, library, kind, tmp_path / "chamber" if on_a_line else None)
