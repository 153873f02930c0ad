"""`bench devices scan` over real sockets and pseudo-terminals, from nothing to a bench file that a check accepts."""

import asyncio
import errno
import re
from pathlib import Path

import pytest
import yaml

from bench.app.scan import address_of, scan_here
from bench.loop import run
from bench.runner.held import address_lock
from drivers.transport import serial
from drivers.transport.address import Address
from simulators.serving.pty import serve_pty
from tests.support.commands import invoked
from tests.support.served import on_real_wires, simulating

pytestmark = pytest.mark.integration

SEQUENCE = """\
schema: itb-sequence/1
title: Switches the supply off
needs: {supply: power_supply}
steps:
  - {set: supply, output: off}
"""


def found_by(*arguments: str) -> tuple[str, str]:
    done = invoked("devices", "scan", *arguments)
    assert done.returncode == 0, done
    return done.stdout, done.stderr


def test_what_a_scan_proposes_is_a_bench_that_a_check_accepts_and_that_answers(tmp_path: Path) -> None:
    bench = on_real_wires(tmp_path)
    content = yaml.safe_load(bench.read_text("utf-8"))
    devices = content["devices"]
    addresses = [devices[role]["connection"] for role in ("chamber", "head", "supply", "source")]
    with simulating(bench):
        proposed, reported = found_by(*(address.partition("?")[0].removeprefix("tcp://") for address in addresses))
        assert "keithley_6220 (KEITHLEY INSTRUMENTS INC. MODEL 6220 SIM-6220-01" in reported
        found = yaml.safe_load(proposed)["devices"]
        assert {role: entry["driver"] for role, entry in found.items()} == {
            role: devices[role]["driver"] for role in ("chamber", "head", "supply", "source")
        }
        content["devices"] = {**devices, **found}
        del content["places"]["a"]["nominal"]  # asks for more current than the proposed limits allow
        with bench.open("w", encoding="utf-8") as file:
            yaml.safe_dump(content, file)
        (tmp_path / "off.yaml").write_text(SEQUENCE, "utf-8")
        checked = invoked("check", str(tmp_path / "off.yaml"), "--bench", str(bench))
        assert checked.returncode == 0, checked
        looked = invoked("devices", "--bench", str(bench))
        assert looked.returncode == 0, looked
        with address_lock([Address.parse(addresses[0])], "a run of smoke"):
            (place,) = scan_here([addresses[0]])
            refused = invoked(
                "run", str(tmp_path / "off.yaml"), "--bench", str(bench), "--uut", "A1",
                "--runs", str(tmp_path / "runs"),
            )  # fmt: skip
            others = [
                invoked(*words, "--bench", str(bench))
                for words in (["devices"], ["trace", "--out", str(tmp_path / "t.trace")], ["console", "chamber"])
            ]
        assert re.match(r"tcp://\S+ is in use by a run of smoke, process \d+. Wait until it has ended", place.words)
        assert (refused.returncode, refused.stderr.splitlines()[-1]) == (3, place.words)
        assert [" is in use by a run of smoke" in other.stderr for other in others] == [True] * 3
        assert not (tmp_path / "runs").exists()


def test_ports_that_cannot_be_had_are_told_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> list[str]:
        loop = asyncio.get_running_loop()
        async with serve_pty(tmp_path / "taken", asyncio.Protocol) as taken:
            other = await serial.open_serial("other", address_of(str(taken)), asyncio.Protocol)
            words = [
                (await loop.run_in_executor(None, scan_here, [text]))[0].words
                for text in (str(taken), str(tmp_path / "missing"), "127.0.0.1:9")
            ]
            del other
            return words

    taken, missing, nobody = run(main())
    assert taken.endswith("another program uses it")
    assert missing.endswith("no such port")
    assert nobody.startswith("no connection to tcp://127.0.0.1:9")


def test_a_port_without_permission_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, **_settings: object) -> None:
        raise serial.serial.SerialException(errno.EACCES, f"could not open port {path}")

    monkeypatch.setattr(serial.serial, "Serial", refuse)
    (place,) = scan_here(["/dev/ttyUSB0"])
    assert "no permission; ask the administrator of this computer to add you to its group" in place.words


def test_ports_go_by_the_names_that_stay_with_their_adapters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        def __init__(self, device: str) -> None:
            self.device, self.description = device, "an adapter"

    for name in ("ttyUSB0", "ttyUSB1"):
        (tmp_path / name).touch()
    (tmp_path / "by-id").mkdir()
    link = tmp_path / "by-id" / "usb-FTDI_A1B2C3-if00-port0"
    link.symlink_to("../ttyUSB1")
    ports = [Port(str(tmp_path / name)) for name in ("ttyUSB0", "ttyUSB1")]
    monkeypatch.setattr(serial.list_ports, "comports", lambda: ports)
    assert [port.path for port in serial.serial_ports(tmp_path / "by-id")] == [str(link), str(tmp_path / "ttyUSB0")]


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("192.168.1.10:502", "tcp://192.168.1.10:502"),
        ("/dev/ttyUSB0", "serial:///dev/ttyUSB0"),
        ("/dev/ttyUSB0?baud=19200&parity=O", "serial:///dev/ttyUSB0?baud=19200&parity=O"),
        ("socket://serial-server:4001", "socket://serial-server:4001"),
    ],
)
def test_an_address_may_be_short(text: str, address: str) -> None:
    assert str(address_of(text)) == address


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["192.168.1.10"], "is not a tcp address"),
        (["sim+tcp://127.0.0.1:502"], "a simulated address has nothing to scan"),
        (["127.0.0.1:9", "--driver", "wattlow_f4"], "there is no driver 'wattlow_f4'; did you mean 'watlow_f4'?"),
        (["127.0.0.1:9", "--driver", "can_counter"], "cannot recognise its instrument by queries"),
    ],
)
def test_what_cannot_be_scanned_is_refused(arguments: list[str], problem: str) -> None:
    done = invoked("devices", "scan", *arguments)
    assert done.returncode == 2
    assert problem in done.stderr
