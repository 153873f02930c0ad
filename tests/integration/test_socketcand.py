"""CAN over real TCP: python-can's client at our server, and our client at a server that says what others recorded."""

import asyncio
import socket
from contextlib import AsyncExitStack
from functools import partial
from itertools import pairwise

import can
import pytest

from bench.app.laboratory import make_laboratory, unit_files
from bench.app.request import load_bench_named
from bench.app.serve import open_servers
from bench.loop import REAL_TIME, run
from drivers.can.frame_block import ERROR, EXTENDED
from drivers.errors import CannotConnect, LinkLost
from drivers.transport.address import Address
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_counter import SimulatedCounter
from simulators.instruments.can_nodes.socketcand_server import SimulatedServer
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.frames import taken
from tests.support.laboratory import a_counter
from tests.support.loopback import SaysHi, linked, served

pytestmark = pytest.mark.integration


def counter(period_s: float) -> SimulatedCounter:
    world = World(WorldSettings(seed=1, gravity_mps2=9.8), asyncio.get_running_loop().time)
    return a_counter(world, FaultPlan(), period_s=period_s)


def test_the_client_of_python_can_reads_our_simulated_counter() -> None:
    def read(port: int) -> list[can.Message]:
        with can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="can0") as bus:
            found = []
            while len(found) < 60 and (message := bus.recv(5.0)) is not None:
                found.append(message)
            return found

    async def main() -> None:
        node = counter(0.01)
        server, port = await served(partial(SimulatedServer, node, "can0"))
        messages = await asyncio.to_thread(read, port)
        assert len(messages) == 60
        assert {message.arbitration_id for message in messages} <= {0x100, 0x101, 0x102, 0x103, 0x110}
        numbers = [int.from_bytes(m.data[4:6], "little") for m in messages if m.arbitration_id == 0x100]
        assert all((b - a) % 65536 == 1 for a, b in pairwise(numbers))
        server.close()

    run(main(), REAL_TIME)


def test_our_client_reads_what_a_server_says_in_pieces() -> None:
    class Server(SaysHi):
        """Texts as they are published, typed by hand."""

        def data_received(self, data: bytes) -> None:
            if data == b"< open can0 >":
                self.transport.write(b"< ok >")
            if data == b"< rawmode >":
                asyncio.get_running_loop().create_task(self.talk())

        async def talk(self) -> None:
            answer = (
                b"< ok >< frame 123 1690000000.000100 0A0B >< frame 1ABCDEF0 1690000000.000200 FFEE >"
                b"< frame 7FF 1690000000.000300  >< error 008 1690000000.000400 >"
            )
            for begin in range(0, len(answer), 7):
                self.transport.write(answer[begin : begin + 7])
                await asyncio.sleep(0.002)

    async def main() -> None:
        server, port = await served(Server)
        link = await linked(port)
        block = await taken(link, 4, 5.0)
        assert block.ids.tolist() == [0x123, 0x1ABCDEF0 | EXTENDED, 0x7FF, ERROR | 0x008]
        assert block.dlc.tolist() == [2, 2, 0, 0]
        link.close()
        server.close()

    run(main(), REAL_TIME)


def test_our_client_reads_our_server_until_that_is_gone() -> None:
    async def main() -> None:
        node = counter(0.001)
        server, port = await served(partial(SimulatedServer, node, "can0"))
        address = Address.parse(f"socketcand://127.0.0.1:{port}/can0")
        link = await RealWires().frames("counter", address)
        block = await taken(link, 1000, 5.0)
        latches = block.data[block.ids == 0x100, 4:6].view("<u2").ravel().astype(int)
        assert ((latches[1:] - latches[:-1]) % 65536 == 1).all()
        node.faults.begin("cut")
        with pytest.raises(LinkLost, match="the socketcand server has closed the connection"):
            await taken(link, 1_000_000, 5.0)
        server.close()
        await server.wait_closed()
        with pytest.raises(CannotConnect, match=r"no connection to socketcand://127\.0\.0\.1"):
            await RealWires().frames("counter", address)

    run(main(), REAL_TIME)


def test_bench_simulate_serves_a_counter_at_the_address_of_its_server() -> None:
    def read(port: int) -> int:
        with can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="can0") as bus:
            message = bus.recv(5.0)
            return -1 if message is None else message.arbitration_id

    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        bench = load_bench_named(None).bench
        address = Address.parse(f"socketcand://127.0.0.1:{port}/can0")
        counter_alone = {"counter": bench.devices["counter"].model_copy(update={"connection": address})}
        laboratory = make_laboratory(bench, unit_files(bench, None), 1, asyncio.get_running_loop().time)
        async with AsyncExitStack() as stack:
            lines = await open_servers(bench.model_copy(update={"devices": counter_alone}), laboratory, stack)
            assert lines == [f"counter    can_counter        {address}"]
            assert await asyncio.to_thread(read, port) == 0x100

    run(main(), REAL_TIME)
