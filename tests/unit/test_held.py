"""One program at a time talks to an address."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bench.errors import InUseError, StoreError
from bench.runner.held import holding
from drivers.transport.address import Address
from tests.support.runs import ROOT

HOLDS = """
import sys
from bench.runner.held import holding
from drivers.transport.address import Address
with holding([Address.parse(sys.argv[1])], "a run of smoke"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "inertial-test-bench"


def hold(*texts: str):
    return holding([Address.parse(text) for text in texts], "somebody")


def test_an_address_is_held_by_one_however_it_is_spelled(tmp_path: Path) -> None:
    (tmp_path / "port").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "port")
    with hold("tcp://10.0.0.1:502", f"serial://{tmp_path}/port?baud=9600"):
        for other in ("socket://10.0.0.1:502", f"serial://{tmp_path}/by-id"):
            with pytest.raises(InUseError, match=rf"{other} is in use by somebody, process {os.getpid()}"), hold(other):
                pass
        with hold("tcp://10.0.0.1:503", "sim+tcp://10.0.0.1:502"):
            pass
    with hold("socket://10.0.0.1:502"):
        pass


def test_instruments_that_share_a_line_are_held_together() -> None:
    with hold("serial:///dev/ttyUSB0?baud=9600", "serial:///dev/ttyUSB0?baud=19200"):
        pass


def test_what_was_held_before_a_refusal_is_let_go() -> None:
    with hold("tcp://10.0.0.1:502"):
        with pytest.raises(InUseError), hold("tcp://10.0.0.1:501", "tcp://10.0.0.1:502"):
            pass
        with hold("tcp://10.0.0.1:501"):
            pass


def test_another_process_is_named_and_its_death_lets_go() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, "tcp://10.0.0.1:502"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(InUseError, match=rf"by a run of smoke, process {process.pid}\. Wait until it has ended"):
            hold("tcp://10.0.0.1:502").__enter__()
        process.kill()
        process.wait()
    with hold("tcp://10.0.0.1:502"):
        pass


def test_a_folder_that_others_can_look_into_is_not_used(own_folder: Path) -> None:
    own_folder.mkdir(mode=0o755)
    own_folder.chmod(0o755)
    with pytest.raises(StoreError, match="is open to others"), hold("tcp://10.0.0.1:502"):
        pass
