"""mbpoll, a Modbus master that other people wrote, reads and writes the simulated F4T over loopback."""

import asyncio
import re
import subprocess
from collections.abc import Awaitable, Callable

import pytest

from bench.loop import run
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = [pytest.mark.integration, pytest.mark.peer("mbpoll")]

Mbpoll = Callable[..., Awaitable[str]]


def with_mbpoll(use: Callable[[Mbpoll], Awaitable[None]]) -> None:
    """Runs `use` with mbpoll aimed at an F4T whose air is at 25 °C."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)), loop.time)
        f4t = SimulatedF4T(world, FaultPlan(now_s=loop.time))
        server = await loop.create_server(protocol_factory(f4t), "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]

        async def mbpoll(*arguments: str) -> str:
            command = ["mbpoll", "-m", "tcp", "-p", str(port), "-a", "1", *arguments]
            done = await asyncio.to_thread(
                subprocess.run, command, capture_output=True, text=True, timeout=20, check=False
            )
            return done.stdout + done.stderr

        try:
            await use(mbpoll)
        finally:
            server.close()
            await server.wait_closed()

    run(main())


def shown(output: str, reference: int) -> str:
    """What mbpoll printed for a register; its references are the wire's addresses plus one."""
    found = re.search(rf"^\[{reference}\]:\s+(\S+)", output, re.MULTILINE)
    assert found, output
    return found[1]


def test_mbpoll_reads_set_point_and_process_value() -> None:
    async def use(mbpoll: Mbpoll) -> None:
        for reference in (2783, 2821):
            output = await mbpoll("-r", str(reference), "-t", "4:float", "-c", "1", "-1", "127.0.0.1")
            assert shown(output, reference) == "25"

    with_mbpoll(use)


def test_mbpoll_writes_a_set_point_and_reads_it_back() -> None:
    async def use(mbpoll: Mbpoll) -> None:
        written = await mbpoll("-r", "2783", "-t", "4:float", "127.0.0.1", "--", "-40.5")
        assert "Written 1 reference" in written
        output = await mbpoll("-r", "2783", "-t", "4:float", "-c", "1", "-1", "127.0.0.1")
        assert shown(output, 2783) == "-40.5"

    with_mbpoll(use)


def test_mbpoll_sees_enumerations_and_refusals() -> None:
    async def use(mbpoll: Mbpoll) -> None:
        assert shown(await mbpoll("-r", "6731", "-t", "4", "-c", "1", "-1", "127.0.0.1"), 6731) == "15"
        assert "Illegal data address" in await mbpoll("-r", "100", "-t", "4", "-c", "1", "-1", "127.0.0.1")
        assert "Illegal data value" in await mbpoll("-r", "2783", "-t", "4:float", "127.0.0.1", "500.0")
        assert "Illegal function" in await mbpoll("-r", "2783", "-t", "3:float", "-c", "1", "-1", "127.0.0.1")

    with_mbpoll(use)
