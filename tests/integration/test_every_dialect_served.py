"""`bench simulate` serves an instrument of every driver at once, and programs of other people speak to each.

It does so twice: with the connections of config/every_dialect.yaml, and with each instrument that can be reached
otherwise on its other kind of wire.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.framer import FramerType

from bench.config.bench import load_bench
from drivers.transport.address import Address
from tests.support.runs import ROOT
from tests.support.served import free_port, simulating

pytestmark = pytest.mark.integration

OTHERWISE = {  # role: how else it is reached
    "converter_supply": "serial://PATH?baud=9600", "keithley": "tcp://127.0.0.1:PORT", "source": "tcp://127.0.0.1:PORT",
    "scanner": "tcp://127.0.0.1:PORT", "f4t": "serial://PATH?baud=38400", "f4": "socket://127.0.0.1:PORT",
    "binder": "serial://PATH?baud=9600", "described": "serial://PATH?baud=19200", "cts": "socket://127.0.0.1:PORT",
    "espec": "serial://PATH?baud=9600",
}  # fmt: skip
LINES = {  # role: how a line ends that it is sent on a serial line; lines, and what is answered to those that ask
    "converter_supply": ("\n", [
        ("*IDN?", r"INERTIAL TEST BENCH,SIM-PSU,SIM-PSU-01,.+"), ("VOLT 5;CURR 0.5", ""), ("OUTP ON", ""),
        ("VOLT?;CURR?;OUTP?", r"5\.0*;0\.50*;1"), ("OUTP OFF", ""), ("NONSENSE", ""), ("SYST:ERR?", r'-113,".+"'),
    ]),
    "keithley": ("\r\n", [
        ("*IDN?", r"KEITHLEY INSTRUMENTS INC\.,MODEL 6220,SIM-6220-01,.+"), ("SOUR:CURR:RANG 2E-3", ""),
        ("SOUR:CURR:COMP 5", ""), ("SOUR:CURR 0.0012", ""), ("OUTP ON", ""),
        ("SOUR:CURR?;:OUTP?", r"1\.20*E-03; ?1"), ("OUTP OFF", ""), ("STAT:MEAS:COND?", "0"), ("SYST:ERR?", "0,.+"),
    ]),
    "gs200": ("\n", [
        ("*IDN?", r"YOKOGAWA,GS210,SIM-GS200-01,.+"), (":SOUR:FUNC CURR", ""), (":SOUR:RANG 1E-2", ""),
        (":SOUR:LEV 2E-3", ""), ("OUTP 1", ""), (":SOUR:LEV?;:OUTP?", r"\+?2\.0*E-03;1"), ("OUTP 0", ""),
        (":SYST:ERR?", "0,.+"),
    ]),
    "source": ("\r", [
        ("*IDN?", r"FLUKE,5730A,SIM-5730A-01,.+"), ("REMOTE", ""), ("OUT 0.0012 A, 0 HZ", ""),
        ("OUT?", r"1\.20*E-03,A,0\.0*E\+00.*"), ("OUT 0 A", ""), ("FAULT?", "0"),
    ]),
    "scanner": ("\n", [
        ("CONF:TEMP FRTD,85,(@101)", ""), ("ROUT:SCAN (@101)", ""), ("ROUT:SCAN?", r"#16\(@101\)"),
        ("READ?", r"\+(1\.9|2\.[01])\d+E\+01"), ("SYST:ERR?", r"\+?0,.+"),
    ]),
    "dvm": ("\n", [
        ("END ALWAYS", ""), ("ID?", "HP3458A"), ("DCV 10", ""), ("NPLC 1", ""), ("RANGE?", "10"),
        ("TARM SGL", r"-?\d\.\d+E-\d\d"), ("ERRSTR?", "0,.+"),
    ]),
    "espec": ("\r\n", [
        ("TEMP?", r"(19|20|21)\.\d,20\.0,.+"), ("TEMP, S21.5", "OK:TEMP, ?S21.5"), ("TEMP?", r".+,21\.5,.+"),
    ]),
}  # fmt: skip
MODBUS = {  # role: register, its type for mbpoll, and how many °C a unit of it is; then the set point's register
    "f4t": (2820, "4:float", 1.0, 2782), "f4": (100, "4", 0.1, 300), "binder": (0x1004, "4:float", 1.0, 0x114C),
    "described": (0, "3", 0.1, 100),
}  # fmt: skip


@pytest.fixture(scope="module", params=["as shipped", "otherwise"])
def served(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapping[str, Address]]:
    """Every instrument of the bench, each by its role, at free ports and in a folder of its own."""
    folder = tmp_path_factory.mktemp("served")
    shutil.copytree(ROOT / "config", folder / "config")
    path = folder / "config/every_dialect.yaml"
    roles = iter(load_bench(path).bench.devices)

    def elsewhere(found: re.Match[str]) -> str:
        role, address = next(roles), found[1]
        if request.param == "otherwise":
            address = OTHERWISE.get(role, address)
        address = re.sub(r":(\d+|PORT)$", f":{free_port()}", address)
        return "connection: " + re.sub(r"/tmp/itb/\w+|PATH", str(folder / role), address)

    path.write_text(re.sub(r"connection: sim\+(\S+)", elsewhere, path.read_text("utf-8")), "utf-8")
    with simulating(path):
        yield {role: entry.connection for role, entry in load_bench(path).bench.devices.items()}


@contextmanager
def opened(address: Address, end: str) -> Iterator[Any]:
    """The instrument at an address as a resource of pyvisa-py; its lines end with LF, or CR LF."""
    import pyvisa

    manager = pyvisa.ResourceManager("@py")
    kind: dict[str, Any] = {"read_termination": "\n", "write_termination": "\n", "timeout": 3000}
    name = f"TCPIP::127.0.0.1::{address.port}::SOCKET"
    if address.scheme == "serial":
        kind |= {"baud_rate": address.option("baud", 9600), "write_termination": end}
        name = f"ASRL{address.path}::INSTR"
    instrument: Any = manager.open_resource(name, **kind)
    try:
        yield instrument
    finally:
        instrument.close()
        manager.close()


@pytest.mark.peer("pyvisa")
@pytest.mark.parametrize("role", list(LINES))
def test_pyvisa_talks_with_what_speaks_in_lines(served: Mapping[str, Address], role: str) -> None:
    end, dialogue = LINES[role]
    with opened(served[role], end) as instrument:
        for line, answer in dialogue:
            if not answer:
                instrument.write(line)
            else:
                found = instrument.query(line).strip()
                assert re.fullmatch(answer, found), (line, found)


@pytest.mark.parametrize("role", list(MODBUS))
def test_pymodbus_reads_and_sets_every_modbus_chamber(served: Mapping[str, Address], role: str) -> None:
    address, (register, kind, scale, set_point) = served[role], MODBUS[role]
    framer = FramerType.SOCKET if address.scheme == "tcp" else FramerType.RTU
    client: ModbusTcpClient | ModbusSerialClient = ModbusTcpClient("127.0.0.1", port=address.port, framer=framer)
    if address.scheme == "serial":
        client = ModbusSerialClient(address.path, framer=framer, baudrate=address.option("baud", 9600))
    with client:
        if kind == "3":
            words = client.read_input_registers(register, count=1, device_id=1).registers
        else:
            words = client.read_holding_registers(register, count=2 if "float" in kind else 1, device_id=1).registers
        raw = client.convert_from_registers(words, client.DATATYPE.FLOAT32, "little") if len(words) > 1 else words[0]
        assert raw * scale == pytest.approx(20, abs=1)
        wanted = [195] if role == "f4" else client.convert_to_registers(19.5, client.DATATYPE.FLOAT32, "little")
        assert not client.write_registers(set_point, wanted, device_id=1).isError()
        assert client.read_holding_registers(set_point, count=len(wanted), device_id=1).registers == wanted
        assert client.read_holding_registers(60000, count=1, device_id=1).exception_code == 2


@pytest.mark.peer("mbpoll", "socat")
@pytest.mark.parametrize("role", list(MODBUS))
def test_mbpoll_reads_every_modbus_chamber(served: Mapping[str, Address], role: str, tmp_path: Path) -> None:
    address, (register, kind, scale, _) = served[role], MODBUS[role]
    link, where = ["-m", "tcp", "-p", str(address.port)], "127.0.0.1"
    with ExitStack() as stack:
        if address.scheme != "tcp":
            where = address.path or str(tmp_path / "line")
            link = ["-m", "rtu", "-b", str(address.option("baud", 9600)), "-P", "none"]
        if address.scheme == "socket":  # a serial line over TCP, made one again
            stack.enter_context(joined(f"pty,rawer,link={where}", f"tcp:127.0.0.1:{address.port}", Path(where)))
        command = ["mbpoll", *link, "-a", "1", "-r", str(register + 1), "-t", kind, "-c", "1", "-1", where]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    found = re.search(rf"^\[{register + 1}\]:\s+(\S+)", done.stdout, re.MULTILINE)
    assert found, done.stdout + done.stderr
    assert float(found[1]) * scale == pytest.approx(20, abs=1)


@contextmanager
def joined(one: str, other: str, there: Path) -> Iterator[None]:
    """socat between two addresses, until the block ends."""
    running = subprocess.Popen(["socat", one, other])
    try:
        for _ in range(100):
            if there.exists():
                break
            time.sleep(0.05)
        yield
    finally:
        running.kill()
        running.wait(timeout=10)
