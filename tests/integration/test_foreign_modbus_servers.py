"""Our drivers of chambers on Modbus servers that other people wrote: pymodbus's own, and libmodbus.

The servers are memories: registers keep what is written. Serial lines are pairs of pseudo-terminals joined by socat.
Debian has no server program of libmodbus; its library is called as its documentation shows.
"""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from drivers.description import IdentityPin, Setup, known_drivers, make_driver
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.words import float32_words
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from drivers.transport.wires import RealWires
from tests.support.chambers import LIMITS
from tests.support.chambers_modbus import HOURLY
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration


def floats(values: Mapping[int, float]) -> dict[int, int]:
    """Words of float32 with the low one first."""
    return {
        address + half: word
        for address, value in values.items()
        for half, word in enumerate(float32_words(value, "low_first"))
    }


F4T = floats({2774: -70.0, 2776: 180.0, 2782: 20.0, 2810: 20.0, 2820: 21.5}) | {
    2812: 0, 2813: 0, 2814: 10, 2815: 0, 2816: 0, 2817: 0, 2818: 0, 2819: 0, 6730: 15, 14080: 15,
}  # fmt: skip
F4 = {
    0: 5270, 1: 12, 2: 3456, 3: 3, 4: 201, 100: 215, **dict.fromkeys(range(101, 107), 0), 200: 0, 300: 200,
    602: -700 & 0xFFFF, 603: 1800, 606: 1, 901: 1,
}  # fmt: skip
MB1 = floats({0x11A9: 21.5, 0x1077: 20.0, 0x1581: 20.0}) | {0x1A22: 0x0800, 0x123D: 0}
PROFILE = HOURLY.model_copy(update={"ramp": None, "set_point_in_force": None})
DESCRIBED = {0: 0, 1: 21500, 2: 0, 3: 20000, 6: 0xFFFF, 7: 0xFFFF & -20000, 8: 2, 9: 0xFFFF & 48928, 10: 1}
CHAMBERS: Mapping[str, tuple[Mapping[str, Any], Mapping[int, int]]] = {  # driver: its options and the registers
    "watlow_f4t": ({}, F4T),
    "watlow_f4": ({}, F4),
    "binder": ({"controller": "mb1", "range": {"min": "-40 °C", "max": "180 °C"}}, MB1),
    "modbus_chamber": ({"profile": DocumentFile(Path("p.yaml"), PROFILE)}, DESCRIBED),
}
each_server = pytest.mark.parametrize(
    "which", ["pymodbus", pytest.param("libmodbus", marks=pytest.mark.peer("libmodbus"))]
)


@contextmanager
def process(*command: object, until: str = "") -> Iterator[subprocess.Popen[str]]:
    """A program until the block ends; it is up when it has said `until`."""
    running = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        if until:
            assert running.stdout is not None
            assert running.stdout.readline().strip() == until
        yield running
    finally:
        running.kill()
        running.communicate(timeout=10)


@contextmanager
def server(which: str, where: object, registers: Mapping[int, int]) -> Iterator[None]:
    words = json.dumps({str(address): word for address, word in registers.items()})
    with process(sys.executable, "-m", "tests.support.foreign_modbus", which, where, words, until="ready"):
        time.sleep(0.5)  # pymodbus says nothing when it listens
        yield


@contextmanager
def line(folder: Path) -> Iterator[tuple[Path, Path]]:
    """The two ends of a serial line."""
    ends = folder / "chamber", folder / "bench"
    with process("socat", *(f"pty,rawer,link={end}" for end in ends)):
        for _ in range(100):
            if all(end.exists() for end in ends):
                break
            time.sleep(0.05)
        yield ends


def make_it_safe(driver: str, options: Any, address: str) -> tuple[float, float, float]:
    """Opens the driver, makes the chamber safe, and tells what it sees before and after it."""
    description = known_drivers()[driver]

    async def main() -> tuple[float, float, float]:
        setup = Setup(
            name="chamber", address=Address.parse(address), wires=RealWires(),
            options=description.options.model_validate(options), limits=ChamberLimits.model_validate(LIMITS),
            safe=ChamberSafe(), identity=IdentityPin(),
        )  # fmt: skip
        chamber = make_driver(description, setup)
        assert isinstance(chamber, Chamber)
        async with chamber:
            before = await chamber.state()
            await chamber.make_safe()
            return before.process_value_c, before.target_c, (await chamber.state()).target_c

    return run(main())


@pytest.mark.parametrize("driver", ["watlow_f4t", "modbus_chamber"])
@each_server
def test_over_tcp(which: str, driver: str) -> None:
    options, registers = CHAMBERS[driver]
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with server(which, port, registers):
        assert make_it_safe(driver, options, f"tcp://127.0.0.1:{port}") == (21.5, 20.0, 25.0)


@pytest.mark.peer("socat")
@pytest.mark.parametrize("driver", list(CHAMBERS))
@each_server
def test_on_a_serial_line(which: str, driver: str, tmp_path: Path) -> None:
    options, registers = CHAMBERS[driver]
    with line(tmp_path) as (chamber, bench), server(which, chamber, registers):
        assert make_it_safe(driver, options, f"serial://{bench}?baud=9600") == (21.5, 20.0, 25.0)
