"""Modbus masters that other people wrote on our simulated chambers, of every dialect, on TCP and on serial lines.

mbpoll (libmodbus), pyModbusTCP, modbus-tk, and watlow-f4 (minimalmodbus), which knows the registers of an F4.
chamberconnectlibrary, which is for Python 2, has a module of its own: test_chamberconnect.
"""

import asyncio
import re
import subprocess
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from bench.loop import run
from drivers.dialects.binder.wire import MODE, Kind, Mode
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.binder import SimulatedBinder
from simulators.instruments.chambers.modbus_chamber import SimulatedProfile
from simulators.instruments.chambers.watlow_f4 import SimulatedF4
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.pty import serve_pty
from simulators.serving.serve import Instrument, protocol_factory
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.chambers_modbus import FICTIONAL, HOURLY

pytestmark = pytest.mark.integration

Make = Callable[[World, FaultPlan], Instrument]
Use = Callable[[Any, World], Awaitable[None]]
SERIAL_F4T, TCP_F4T = (lambda world, faults, on=on: SimulatedF4T(world, faults, serial_line=on) for on in (True, False))


def a_world() -> World:
    """Its air is at 25 °C."""
    chamber = ChamberPhysics(start_c=25.0, limit_cycle_c=0.0)
    return World(WorldSettings(1, 9.8, chamber=chamber), asyncio.get_running_loop().time)


def on_tcp(make: Make, use: Use) -> None:
    """Runs `use` with the port of a simulator, and its world."""

    async def main() -> None:
        world = a_world()
        instrument = make(world, FaultPlan(now_s=world.now))
        server = await asyncio.get_running_loop().create_server(protocol_factory(instrument), "127.0.0.1", 0)
        async with server:
            await use(server.sockets[0].getsockname()[1], world)

    run(main())


def on_a_line(make: Make, use: Use, path: Path) -> None:
    """Runs `use` with the serial device of a simulator, and its world."""

    async def main() -> None:
        world = a_world()
        async with serve_pty(path, protocol_factory(make(world, FaultPlan(now_s=world.now)))):
            await use(path, world)

    run(main())


def leaves_at(set_point_c: float, talk: Callable[[Any], None]) -> Use:
    """Lets `talk` do what it does in a thread of its own; the chamber then has this set point."""

    async def use(where: object, world: World) -> None:
        await asyncio.to_thread(talk, where)
        assert world.thermal.set_point_c == set_point_c

    return use


async def mbpoll(where: object, register: int, kind: str, *written: str) -> str:
    """What mbpoll says of one value at a wire address; its own references begin with 1."""
    link = ["-m", "tcp", "-p", str(where)] if isinstance(where, int) else ["-m", "rtu", "-b", "9600", "-P", "none"]
    command = ["mbpoll", *link, "-a", "1", "-r", str(register + 1), "-t", kind]
    command += [] if written else ["-c", "1", "-1"]
    command += ["127.0.0.1" if isinstance(where, int) else str(where), *(["--", *written] if written else [])]
    done = await asyncio.to_thread(subprocess.run, command, capture_output=True, text=True, timeout=20, check=False)
    found = re.search(rf"^\[{register + 1}\]:\s+(\S+)", done.stdout, re.MULTILINE)
    return found[1] if found else done.stdout + done.stderr


def binder(kind: Kind) -> Make:
    return lambda world, faults: SimulatedBinder(world, faults, kind=kind)


LINES: Mapping[str, tuple[Make, tuple[int, str, str], tuple[int, str, str]]] = {
    # simulator; where the process value is, its type for mbpoll, and 25 °C; the same of the set point, and -40.5 °C
    "f4t": (SERIAL_F4T, (2820, "4:float", "25"), (2782, "4:float", "-40.5")),
    "f4": (SimulatedF4, (100, "4", "250"), (300, "4", "65131")),
    "mb2": (binder("mb2"), (0x1004, "4:float", "25"), (0x114C, "4:float", "-40.5")),
    "fictional": (
        lambda world, faults: SimulatedProfile(world, faults, FICTIONAL, serial_line=True),
        (0, "3", "250"), (100, "4:float", "-40.5"),
    ),
}  # fmt: skip


@pytest.mark.peer("mbpoll")
@pytest.mark.parametrize("name", list(LINES))
def test_mbpoll_reads_and_writes_on_a_serial_line(name: str, tmp_path: Path) -> None:
    make, (measured, measured_kind, value), (set_point, kind, wanted) = LINES[name]

    async def use(path: Path, world: World) -> None:
        assert await mbpoll(path, measured, measured_kind) == value
        assert "Written 1 reference" in await mbpoll(path, set_point, kind, wanted)
        assert await mbpoll(path, set_point, kind) == wanted
        assert world.thermal.set_point_c == -40.5
        assert "Illegal data address" in await mbpoll(path, 9999, "4")

    on_a_line(make, use, tmp_path / "chamber")


@pytest.mark.peer("mbpoll")
def test_mbpoll_has_to_write_the_set_point_of_an_mb1_before_its_mode(tmp_path: Path) -> None:
    async def use(path: Path, world: World) -> None:
        assert await mbpoll(path, 0x11A9, "4:float") == "25"
        await mbpoll(path, 0x1581, "4:float", "40")
        assert world.thermal.set_point_c == 25.0
        await mbpoll(path, MODE, "4", str(int(Mode.MANUAL)))
        assert world.thermal.set_point_c == 40.0
        assert await mbpoll(path, 0x1077, "4:float") == "40"

    on_a_line(binder("mb1"), use, tmp_path / "chamber")


@pytest.mark.peer("mbpoll")
def test_mbpoll_reads_numbers_of_32_bits_with_the_high_word_first() -> None:
    async def use(port: int, world: World) -> None:
        assert await mbpoll(port, 0, "4:hex") == "0x0000"
        assert await mbpoll(port, 1, "4") == "25000"

    on_tcp(lambda world, faults: SimulatedProfile(world, faults, HOURLY), use)


@pytest.mark.peer("pyModbusTCP")
def test_pymodbustcp_reads_and_writes_an_f4t() -> None:
    from pyModbusTCP.client import ModbusClient
    from pyModbusTCP.utils import decode_ieee, word_list_to_long

    def talk(port: int) -> None:
        client = ModbusClient("127.0.0.1", port, unit_id=1, auto_open=True, timeout=5)
        words = client.read_holding_registers(2820, 2)
        assert decode_ieee(word_list_to_long(words, big_endian=False)[0]) == 25.0
        assert client.write_multiple_registers(2782, [0x0000, 0xC220])
        assert client.read_holding_registers(2782, 2) == [0x0000, 0xC220]
        assert client.write_single_register(2796, 57)
        assert client.read_holding_registers(1, 1) is None
        assert client.last_except == 2
        assert client.read_input_registers(2820, 2) is None
        assert client.last_except == 1
        client.close()

    on_tcp(TCP_F4T, leaves_at(-40.0, talk))


@pytest.mark.peer("pyModbusTCP")
def test_pymodbustcp_finds_input_and_holding_registers_as_the_profile_says() -> None:
    from pyModbusTCP.client import ModbusClient

    def talk(port: int) -> None:
        client = ModbusClient("127.0.0.1", port, unit_id=1, auto_open=True, timeout=5)
        assert client.read_input_registers(0, 1) == [250]
        assert client.read_holding_registers(0, 1) == [4711]
        assert client.write_single_register(120, 2)
        assert client.read_holding_registers(120, 1) == [2]
        assert not client.write_single_register(120, 99)
        assert client.last_except == 3
        client.close()

    async def use(port: int, world: World) -> None:
        await asyncio.to_thread(talk, port)

    on_tcp(lambda world, faults: SimulatedProfile(world, faults, FICTIONAL), use)


@pytest.mark.peer("modbus_tk")
def test_modbus_tk_reads_and_writes_an_f4t_and_is_told_what_it_has_not() -> None:
    from modbus_tk import defines, modbus_tcp
    from modbus_tk.modbus import ModbusError

    def talk(port: int) -> None:
        master = modbus_tcp.TcpMaster("127.0.0.1", port)
        master.set_timeout(5)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 2820, 2) == (0, 0x41C8)
        assert master.execute(1, defines.WRITE_MULTIPLE_REGISTERS, 2782, output_value=[0, 0xC220]) == (2782, 2)
        assert master.execute(1, defines.WRITE_SINGLE_REGISTER, 2796, output_value=57) == (2796, 57)
        for function, start, code in (
            (defines.READ_HOLDING_REGISTERS, 1, defines.ILLEGAL_DATA_ADDRESS),
            (defines.READ_COILS, 0, defines.ILLEGAL_FUNCTION), (defines.READ_INPUT_REGISTERS, 2820, 1),
        ):  # fmt: skip
            with pytest.raises(ModbusError) as refused:
                master.execute(1, function, start, 1)
            assert refused.value.get_exception_code() == code
        master.close()

    on_tcp(TCP_F4T, leaves_at(-40.0, talk))


@pytest.mark.peer("modbus_tk")
def test_modbus_tk_reads_and_writes_an_f4_on_a_serial_line(tmp_path: Path) -> None:
    import serial
    from modbus_tk import defines, modbus_rtu

    def talk(path: Path) -> None:
        master = modbus_rtu.RtuMaster(serial.Serial(str(path), 9600))
        master.set_timeout(2)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 100, 1) == (250,)
        assert master.execute(1, defines.WRITE_SINGLE_REGISTER, 300, output_value=0xFE6B) == (300, 0xFE6B)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 300, 1) == (0xFE6B,)
        master.close()

    on_a_line(SimulatedF4, leaves_at(-40.5, talk), tmp_path / "chamber")


@pytest.mark.peer("watlow_f4")
def test_the_driver_of_somebody_else_reads_and_sets_an_f4(tmp_path: Path) -> None:
    from watlow_f4.watlow_f4 import WatlowF4

    def talk(path: Path) -> None:
        f4 = WatlowF4(str(path), 1)
        try:
            assert f4.temperature == 25.0
            f4.temperature_setpoint = -40.5  # which it reads back
            assert f4.temperature_setpoint == -40.5
        finally:
            f4.instrument.serial.close()

    on_a_line(SimulatedF4, leaves_at(-40.5, talk), tmp_path / "chamber")
