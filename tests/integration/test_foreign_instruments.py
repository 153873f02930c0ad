"""Our drivers on instruments that frameworks of other people simulate: lewis, and sinstruments.

What the instruments say is written in tests/support from what is known of their wires; everything else is foreign.
"""

import socket
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from drivers.description import IdentityPin, Setup, known_drivers, make_driver
from drivers.errors import Refused
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.source.driver import ScpiSource
from drivers.transport.address import Address
from drivers.transport.wires import RealWires
from tests.support.chambers import LIMITS
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration

CURRENT = {"current": {"min": "-20 mA", "max": "20 mA"}}
DEVICES = """\
devices:
- {{name: {name}, class: {name}, package: tests.support.foreign_sinstruments, transports: [{{{transport}}}]}}
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def program(*arguments: object, there: Callable[[], bool]) -> Iterator[None]:
    """A Python module as a program, from when it serves to the end of the block."""
    running = subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    try:
        until = time.monotonic() + 20
        while not there():
            assert running.poll() is None, running.communicate()[1]
            assert time.monotonic() < until, "it does not serve"
            time.sleep(0.05)
        yield
    finally:
        running.kill()
        running.communicate(timeout=10)


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def with_driver(name: str, address: str, use: Callable[[Any], Awaitable[None]], limits: Any, **options: object) -> None:
    """Opens a driver at an address and uses it."""
    description = known_drivers()[name]

    async def main() -> None:
        setup = Setup(
            name="device", address=Address.parse(address), wires=RealWires(),
            options=description.options.model_validate(options), limits=description.limits.model_validate(limits),
            safe=description.safe(), identity=IdentityPin(),
        )  # fmt: skip
        async with make_driver(description, setup) as driver:
            await use(driver)

    run(main())


@pytest.mark.peer("lewis")
def test_a_p300_in_lewis_is_taken_over_from_its_program() -> None:
    async def use(chamber: Chamber) -> None:
        assert (await chamber.identify()).model == "S2"
        before = await chamber.state()
        assert (before.process_value_c, before.target_c) == (23.1, 20.0)
        await chamber.make_safe()
        assert (await chamber.state()).target_c == 25.0

    port = free_port()
    lewis = ("lewis", "espec_p300", "-k", "tests.support.foreign_lewis", "-c", "0.02", "-o", "error")
    options = f"stream: {{bind_address: 127.0.0.1, port: {port}}}"
    with program(*lewis, "-p", options, there=lambda: answers(port)):
        with_driver("espec_p300", f"tcp://127.0.0.1:{port}", use, LIMITS)


async def set_and_refused(source: ScpiSource[Any], serial: str, too_much: str) -> None:
    """Sets a current of either sign, is told what the instrument refuses, and makes it safe."""
    assert (await source.identify()).serial == serial
    await source.set(0.0012, limit=5, output=True)
    assert (await source.poll())["current"][0].value == pytest.approx(0.0012)
    await source.set(-0.0009, limit=5, output=True)
    assert (await source.read()).output
    with pytest.raises(Refused, match="-222"):
        await source._link.write(too_much)
    await source.make_safe()
    reading = await source.read()
    assert (reading.current_a, reading.output) == (0, False)


@pytest.mark.peer("sinstruments")
def test_a_gs200_in_sinstruments_that_was_left_a_voltage_source(tmp_path: Path) -> None:
    port, file = free_port(), tmp_path / "devices.yml"
    file.write_text(DEVICES.format(name="GS200", transport=f'type: tcp, url: ["127.0.0.1", {port}]'))
    use = partial(set_and_refused, serial="91W000001", too_much=":SOUR:LEV 7")
    with program("sinstruments", "-c", file, there=lambda: answers(port)):
        with_driver("yokogawa_gs200", f"tcp://127.0.0.1:{port}", use, CURRENT, range="10 mA", compliance="10 V")


@pytest.mark.peer("sinstruments")
def test_a_6220_in_sinstruments_on_its_pseudo_terminal(tmp_path: Path) -> None:
    line, file = tmp_path / "source", tmp_path / "devices.yml"
    file.write_text(DEVICES.format(name="Keithley6220", transport=f"type: serial, url: {line}, baudrate: 19200"))
    use = partial(set_and_refused, serial="1234567", too_much=":SOUR:CURR 7")
    options = {"range": "2 mA", "compliance": "10 V", "terminator": "cr"}
    with program("sinstruments", "-c", file, there=line.exists):
        with_driver("keithley_6220", f"serial://{line}?baud=19200", use, CURRENT, **options)
