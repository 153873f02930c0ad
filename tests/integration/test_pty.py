"""Serial ports in real time: pseudo-terminals that simulated instruments answer, and our own serial transport."""

import asyncio
import os
import tty
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import serial

from bench.loop import run
from drivers.description import IdentityPin, Nothing, Setup
from drivers.dialects.keithley_6220.description import KeithleyOptions
from drivers.dialects.keithley_6220.driver import Keithley6220
from drivers.errors import BadAnswer, CannotConnect, LinkLost
from drivers.kinds.ranges import SourceLimits
from drivers.transport.address import Address
from drivers.transport.exchange import LineExchange, Pace, SyncQuery
from drivers.transport.serial import DeviceTransport, join_device, open_serial
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.sources.keithley_6220 import SimulatedKeithley
from simulators.serving.pty import serve_pty
from simulators.serving.serve import protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World

pytestmark = pytest.mark.integration


class Echo(asyncio.Protocol):
    """Says what it hears."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, DeviceTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.transport.write(data)


class Ear(asyncio.Protocol):
    """Keeps what it hears, and knows when the line is gone."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.fresh = asyncio.Event()
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, DeviceTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.heard += data
        self.fresh.set()

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.set_result(exc)

    async def has(self, count: int) -> bytes:
        async with asyncio.timeout(5):
            while len(self.heard) < count:
                self.fresh.clear()
                await self.fresh.wait()
        return bytes(self.heard)


def address_of(path: Path) -> Address:
    return Address.parse(f"serial://{path}?baud=19200")


@asynccontextmanager
async def a_source(path: Path) -> AsyncIterator[SimulatedKeithley]:
    loop = asyncio.get_running_loop()
    source = SimulatedKeithley(World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time), FaultPlan(now_s=loop.time))
    async with serve_pty(path, protocol_factory(source)):
        yield source


def a_driver(path: Path) -> Keithley6220:
    options = KeithleyOptions.model_validate({"range": "20 mA", "compliance": "10 V"})
    limits = SourceLimits.model_validate({"current": {"min": "-20 mA", "max": "20 mA"}})
    return Keithley6220(
        Setup("source", address_of(path), RealWires(), options, limits, Nothing(), IdentityPin(serial="SIM-6220-01"))
    )


# The pseudo-terminal


def test_bytes_pass_both_ways_as_they_are(tmp_path: Path) -> None:
    async def main() -> None:
        async with serve_pty(tmp_path / "deep" / "port", Echo) as path:
            ear = await open_serial("ear", address_of(path), Ear)
            every_byte = bytes(range(256)) * 4
            ear.transport.write(every_byte)
            assert await ear.has(1024) == every_byte
            ear.transport.close()
            assert await ear.lost is None

    run(main())


def test_clients_may_come_and_go(tmp_path: Path) -> None:
    async def main() -> None:
        async with serve_pty(tmp_path / "port", Echo) as path:
            for word in (b"one", b"two", b"three"):
                ear = await open_serial("ear", address_of(path), Ear)
                ear.transport.write(word)
                assert await ear.has(len(word)) == word
                ear.transport.close()

    run(main())


def test_the_link_is_there_while_it_is_served_and_a_stale_one_is_replaced(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "port"
        path.symlink_to("/dev/pts/999999")
        async with serve_pty(path, Echo):
            assert path.readlink() != Path("/dev/pts/999999")
            assert path.is_char_device()
        assert not path.is_symlink()

    run(main())


@pytest.mark.parametrize("what", ["file", "folder", "link to a file"])
def test_nothing_else_is_ever_replaced(tmp_path: Path, what: str) -> None:
    async def main() -> None:
        path, target = tmp_path / "port", tmp_path / "target"
        target.write_text("precious")
        match what:
            case "file":
                path.write_text("precious")
            case "folder":
                path.mkdir()
            case _:
                path.symlink_to(target)
        before = os.listdir("/proc/self/fd")
        with pytest.raises(FileExistsError):
            await serve_pty(path, Echo).__aenter__()
        await asyncio.sleep(0.01)
        assert len(os.listdir("/proc/self/fd")) == len(before)
        assert target.read_text() == "precious"
        assert path.exists()

    run(main())


def test_a_link_that_somebody_else_put_there_is_left(tmp_path: Path) -> None:
    async def main() -> None:
        async with serve_pty(tmp_path / "port", Echo) as path:
            path.unlink()
            path.symlink_to("/dev/pts/999999")
        assert path.is_symlink()

    run(main())


# The serial transport


def test_a_port_belongs_to_one_client(tmp_path: Path) -> None:
    async def main() -> None:
        async with serve_pty(tmp_path / "port", Echo) as path:
            ear = await open_serial("ear", address_of(path), Ear)
            with pytest.raises(CannotConnect, match=r"other: cannot open serial://.*no other program has the port"):
                await open_serial("other", address_of(path), Ear)
            ear.transport.close()
            ear.transport.abort()
            assert ear.transport.is_closing()
            again = await open_serial("other", address_of(path), Ear)
            again.transport.close()

    run(main())


def test_a_port_that_is_not_there_cannot_be_opened(tmp_path: Path) -> None:
    async def main() -> None:
        for path in (tmp_path / "nothing", tmp_path):
            with pytest.raises(CannotConnect, match="Check the path"):
                await open_serial("ear", address_of(path), Ear)
        with pytest.raises(CannotConnect):
            await open_serial("ear", Address("serial", path="/dev/null", options={"parity": "X"}), Ear)

    run(main())


def test_what_is_no_character_device_is_closed_again(tmp_path: Path) -> None:
    async def main() -> None:
        with (tmp_path / "file").open("w+b", buffering=0) as file:
            with pytest.raises(ValueError, match="Pipe transport"):
                await join_device(file, Ear())
            assert file.closed

    run(main())


def test_the_other_end_going_away_is_a_lost_connection(tmp_path: Path) -> None:
    async def main() -> None:
        near, far = os.openpty()
        tty.setraw(far)
        ear = await open_serial("ear", address_of(Path(os.ttyname(far))), Ear)
        os.close(far)
        os.close(near)
        async with asyncio.timeout(5):
            await ear.lost
        assert ear.transport.is_closing()
        ear.transport.write(b"nobody hears this")
        ear.transport.close()

    run(main())


def test_writing_to_an_end_that_is_gone_is_a_lost_connection(tmp_path: Path) -> None:
    async def main() -> None:
        near, far = os.openpty()
        tty.setraw(far)
        ear = await open_serial("ear", address_of(Path(os.ttyname(far))), Ear)
        os.close(far)
        os.close(near)
        ear.transport.write(b"nobody hears this")
        async with asyncio.timeout(5):
            await ear.lost

    run(main())


def test_an_exchange_over_a_real_line_can_be_cancelled(tmp_path: Path) -> None:
    class Late(Echo):
        def data_received(self, data: bytes) -> None:
            delay_s = 0.05 if data == b"1\n" else 0.0
            asyncio.get_running_loop().call_later(delay_s, self.transport.write, data)

    async def main() -> None:
        proof = SyncQuery(b"who?", bytes)
        async with serve_pty(tmp_path / "port", Late) as path:
            pace = Pace(answer_s=2.0, quiet_s=0.1)
            line = await open_serial("late", address_of(path), lambda: LineExchange("late", proof, pace=pace))
            asked = asyncio.create_task(line.query(b"1", int))
            await asyncio.sleep(0.01)
            asked.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asked
            assert await line.query(b"2", int) == 2
            line.close()

    run(main())


# A driver over it


def test_a_driver_works_over_a_real_serial_line(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "source"
        async with a_source(path) as source:
            async with a_driver(path) as driver:
                await driver.set(-0.0012, limit=5, output=True)
                assert source.current_a == pytest.approx(-0.0012)
                assert (await driver.poll())["current"][0].value == pytest.approx(-0.0012)
                await driver.make_safe()
                assert source.current_a == 0
            async with a_driver(path) as driver:  # the port is free again
                assert (await driver.identify()).serial == "SIM-6220-01"

    run(main())


def test_a_driver_notices_the_instrument_going_and_finds_it_again(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "source"
        async with a_source(path):
            driver = await a_driver(path).__aenter__()
        with pytest.raises((LinkLost, BadAnswer)):
            async with asyncio.timeout(5):
                await driver.read()
        with pytest.raises(CannotConnect):
            await driver.make_safe()
        async with a_source(path) as source:
            source.session().feed(b":SOUR:CURR 0.001;:OUTP ON\r")
            await driver.make_safe()
            assert source.current_a == 0
            await driver.__aexit__()

    run(main())


def test_a_port_that_cannot_turn_the_line_round_is_refused_in_words() -> None:
    async def main() -> None:
        leader, follower = os.openpty()
        address = Address.parse(f"serial://{os.ttyname(follower)}?rs485=rts")
        with pytest.raises(CannotConnect, match=r"this port cannot switch the RS-485 direction by RTS \(Failed to set"):
            await open_serial("chamber", address, Echo)
        again = Address.parse(f"serial://{os.ttyname(follower)}?rs485=adapter")
        echo = await open_serial("chamber", again, Echo)  # it was let go
        echo.transport.close()
        os.close(leader)
        os.close(follower)

    run(main())


def test_a_port_that_can_is_told_to_hold_rts_while_it_sends(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = []
    monkeypatch.setattr(serial.Serial, "_set_rs485_mode", lambda _port, settings: reported.append(settings))

    async def main() -> None:
        leader, follower = os.openpty()
        echo = await open_serial("chamber", Address.parse(f"serial://{os.ttyname(follower)}?rs485=rts"), Echo)
        echo.transport.close()
        os.close(leader)
        os.close(follower)

    run(main())
    assert [(each.rts_level_for_tx, each.rts_level_for_rx) for each in reported] == [(True, False)]
