"""`bench console`: an instrument by hand, in its own language and through its driver."""

import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.app.byhand_lines import Unsendable, _parsed
from bench.runner.held import address_lock
from drivers.discovery.recognition import is_scpi_query
from drivers.transport.address import Address
from tests.support.commands import invoked
from tests.support.runs import ROOT, copy_bench
from tests.support.served import on_real_wires, simulating

pytestmark = pytest.mark.slow


def console(*arguments: str, typed: str) -> tuple[int, list[str]]:
    """What a console of a simulated device says, without the times."""
    done = invoked("console", *arguments, typed=typed)
    return done.returncode, [re.sub(r"^ +\d+\.\d{3} ", "", line) for line in done.stdout.splitlines()]


def test_modbus_is_read_in_words_beside_the_bytes_and_the_driver_is_asked_on_the_same_connection() -> None:
    wrong = "hello\n:raed\n:frames\nread 70000\nwrite 2782 0 16880\n\n:help\nread 60000\n"
    code, reported = console("chamber", typed=f"{wrong}read 2782 2\n:status\n:identify\n:read\n")
    assert code == 3
    assert "there is no command :raed; did you mean ':read'?" in reported
    assert "chamber sends no frames" in reported
    assert sum(line.startswith("expected read ADDRESS") for line in reported) == 1
    assert "an address or a word is more than 65535" in reported
    assert "not sent: this is not a query; --write allows it" in reported
    assert (
        "read ADDRESS [COUNT]      holding registers, by their address on the wire, such as 2782 or 0x0ade" in reported
    )
    assert "refused, exception 2" in reported
    assert reported[0].startswith("Only known queries are sent")
    at = reported.index("> 00 01 00 00 00 06 01 03 0a de 00 02")  # its own numbers, which the driver does not see
    assert reported[at + 1 : at + 3] == [
        "< 00 01 00 00 00 07 01 03 04 00 00 41 a0",
        "2782: 0 16800 (hexadecimal 0000 41a0); as float32 20 low word first",
    ]
    assert sum(line.startswith("+ ") for line in reported) == 1
    assert any(
        re.fullmatch(r"process_value_c 20\.\d+, set_point_c 20\.0, target_c 20\.0, from_safe_c 5\.0", line)
        for line in reported
    )
    assert any(line.startswith("maker Watlow, model F4T, serial SIM-F4T-01") for line in reported)
    assert "set_point 20 °C" in reported
    assert not any("06 01 06" in line or "01 10" in line for line in reported), "nothing was written"


def test_a_write_needs_leave_and_a_second_time_and_leaves_the_chamber_safe() -> None:
    write = "write 2782 0 16880\n"
    code, reported = console("chamber", "--write", typed=f"{write}read 2782 2\n:status\n{write}{write}:status\n")
    assert code == 0
    assert reported.count("not sent yet: type the same line again to send it") == 2, "a question in between forgets it"
    assert reported.count("acknowledged") == 1
    assert any("target_c 20.0" in line for line in reported[: reported.index("acknowledged")])
    assert any("target_c 30.0" in line for line in reported)
    assert reported[-2:] == ["chamber is in its safe state.", "-"]
    assert any(" 10 0a de 00 02 04 00 00 41 c8" in line for line in reported), "25 °C"


def test_questions_go_to_a_scpi_instrument_and_nothing_else_without_leave() -> None:
    typed = "*IDN?\nOUTP ON\n*IDN?;OUTP ON\n*TST?\n:SOUR:CURR?\n"
    code, reported = console("source", typed=typed)
    assert code == 3
    assert reported.count("not sent: this is not a query; --write allows it") == 3
    assert r'> ":SOUR:CURR?\r\n"' in reported
    assert not any("OUTP ON" in line or "*TST" in line for line in reported if line.startswith(">"))
    assert "source is in its safe state." not in reported


def test_a_source_that_was_switched_on_by_hand_is_off_at_the_end() -> None:
    typed = "CURR 0.001\nOUTP ON;*IDN?\n:status\nSYST:ERR?\n:quit\nnever read\n"
    code, reported = console("source", "--write", typed=typed)
    assert code == 0
    assert reported[0].startswith(
        "What you type is sent to the instrument unchanged: it may move, heat or energise something."
    )
    assert "no answer within 1 s (usual for a command that is not a query)" in reported
    assert "current_a 0.001, output True" in reported
    assert r'> ":SOUR:CURR 0;:OUTP OFF\r\n"' in reported
    assert reported[-2] == "source is in its safe state."


def test_a_head_is_asked_and_told_by_hand() -> None:
    code, reported = console("head", "--write", typed="PFBK X\n:status\n:safe\n")
    assert code == 0
    assert "angle_deg 0" in reported
    assert reported.count("head is in its safe state.") == 2
    at = reported.index(r'> "PFBK X\n"')
    assert reported[at + 1] == r'< "%0.000000\n"'


def test_frames_are_shown_decoded() -> None:
    code, reported = console("counter", typed=":frames\nhello\n:read\n")
    assert code == 3
    shown = [line for line in reported if line.startswith("100#")]
    assert 15 <= len(shown) <= 25
    assert re.fullmatch(r"100#[0-9A-F]{16} Latch: Tick \S+ us, Sequence \d+, Status 0, BootCount \d+", shown[0])
    assert "not sent: this protocol does not mark queries; --write allows it" in reported
    assert any(line.startswith(("Temperatures.Unit ", "no new reading yet; ")) for line in reported)


def test_a_device_that_is_not_there_is_not_opened(tmp_path: Path) -> None:
    found = invoked("console", "chambr")
    assert (found.returncode, "the bench has no device 'chambr'; did you mean 'chamber'" in found.stderr) == (2, True)
    bench = str(copy_bench(tmp_path, ("sim+tcp://127.0.0.1:5025", "tcp://127.0.0.1:9")))
    with address_lock([Address.parse("tcp://127.0.0.1:9")], "a run of tumble_static"):
        found = invoked("console", "supply", "--bench", bench, typed=":read\n")
    assert found.returncode == 3
    assert re.match(r"tcp://127\.0\.0\.1:9 is in use by a run of tumble_static, process \d+", found.stderr)
    found = invoked("console", "supply", "--bench", bench, typed=":read\n")
    assert (found.returncode, "supply: no connection to tcp://127.0.0.1:9" in found.stderr) == (3, True)


@pytest.mark.parametrize(
    ("line", "asks"),
    [
        ("*IDN?", True), (":VOLT?;:CURR?", True), ("MEAS:VOLT?", False), (":READ?", False), ("*TST?", False),
        ("OUTP ON", False), ("*IDN?;*RST", False), ("*IDN?;VOLT 5", False), ("", False), (";", False),
        ('DISP:TEXT "who?"', False), ("SOUR:CURR?", True), ("CALibration:DATE?", False),
    ],
)  # fmt: skip
def test_a_question_is_told_from_what_does_something(line: str, asks: bool) -> None:
    assert is_scpi_query(line) is asks


@pytest.mark.parametrize(
    "line",
    ["read", "read x", "read 1 2 3", "read 1 0", "read 1 101", "write 1", "write 1 65536", "read 010", "read -1"],
)
def test_what_is_no_request_for_registers_is_not_sent(line: str) -> None:
    with pytest.raises(Unsendable):
        _parsed(line)


@pytest.mark.integration
def test_it_talks_at_a_terminal_over_real_wires(tmp_path: Path) -> None:
    bench = on_real_wires(tmp_path)
    near, far = os.openpty()
    with simulating(bench):
        process = subprocess.Popen(
            [sys.executable, "-m", "bench", "console", "source", "--bench", str(bench)],
            stdin=far, stdout=far, stderr=far, cwd=ROOT,
        )  # fmt: skip
        os.close(far)
        try:
            assert "--write allows all commands" in received(near, "SYST:ERR")
            os.write(near, b"*IDN?\n")
            assert "SIM-6220-01" in received(near, "MODEL 6220")
            os.write(near, b":status\n")
            received(near, "current_a 0.0")
            os.write(near, b"\x04")  # the end of what is typed
            assert process.wait(20) == 0
        finally:
            process.kill()
            process.wait()
            os.close(near)


def received(descriptor: int, expected: str) -> str:
    """All that a terminal shows until something expected is there."""
    message, end_s = "", time.monotonic() + 30.0
    while expected not in message:
        assert time.monotonic() < end_s, message
        if select.select([descriptor], [], [], 1.0)[0]:
            message += os.read(descriptor, 4096).decode()
    return message
