"""One program at a time talks to an instrument, whoever runs it and however its address is spelled."""

from __future__ import annotations

import os
import pty
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from bench.errors import InUseError
from bench.runner.held import Kind, address_lock, marks, owners
from drivers.transport.address import Address
from tests.support.guardians import stop
from tests.support.runs import ROOT

PORT = 2000 + os.getpid() % 7_990  # other tests on this machine hold other ports
HOST = f"tcp://10.0.0.1:{PORT}"
HOLDS = """
import encodings.idna, os, sys
from bench.runner.held import address_lock
from drivers.transport.address import Address
os.setuid(int(sys.argv[2]))
with address_lock([Address.parse(sys.argv[1])], "a run of smoke"):
    print("held", flush=True)
    sys.stdin.read()
"""
NOBODY = 65534


def hold(*texts: str):
    return address_lock([Address.parse(text) for text in texts], "somebody")


@contextmanager
def another(text: str, user: int | None = None, environment: Mapping[str, str] = os.environ) -> Iterator[int]:
    """Another process holds an address meanwhile, its number given."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, text, str(os.getuid() if user is None else user)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=dict(environment),
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == b"held\n"
            yield process.pid
        finally:
            process.kill()


def refused(text: str) -> str:
    with pytest.raises(InUseError) as found, hold(text):
        pass
    return str(found.value)


@pytest.mark.parametrize(
    "other",
    [
        "tcp://127.0.0.1:{}", "tcp://LOCALHOST:{}", "tcp://[::1]:{}", "tcp://[::ffff:127.0.0.1]:{}", "tcp://127.1:{}",
        "tcp://127.0.0.2:{}", "tcp://0.0.0.0:{}", "tcp://2130706433:{}", "tcp://localhost:0{}", "socket://localhost:{}",
    ],
)  # fmt: skip
def test_this_machine_is_one_place_however_it_is_spelled(other: str) -> None:
    with hold(f"tcp://localhost:{PORT}"):
        assert f"is in use by somebody, process {os.getpid()}." in refused(other.format(PORT))


@pytest.mark.parametrize("words", ["a short look of it", "in other words", "two\nlines"])
@pytest.mark.parametrize("kind", Kind)
def test_the_kind_of_an_owner_does_not_depend_on_its_words(words: str, kind: Kind) -> None:
    at = [Address.parse(HOST)]
    with address_lock(at, words, kind):
        (owner,) = owners(at)
    assert (owner.words, owner.kind) == (words.replace("\n", "?"), kind)


def test_a_short_reading_by_another_program_is_waited_for() -> None:
    with ExitStack() as held:
        held.enter_context(address_lock([Address.parse(HOST)], "somebody", Kind.VISIT))
        ending = threading.Timer(0.5, held.close)
        ending.start()
        with hold(HOST):
            ending.join()


def test_an_own_address_of_this_machine_is_this_machine() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has no network")
        own = probe.getsockname()[0]
    assert marks(Address.parse(f"tcp://{own}:502")) == marks(Address.parse("tcp://localhost:502"))


def test_every_address_of_a_name_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    def two_addresses(_host: str, _port: None, **_: object) -> list[tuple[object, ...]]:
        return [(0, 0, 0, "", ("10.0.0.1", 0)), (0, 0, 0, "", ("2001:db8::1", 0, 0, 0))]

    monkeypatch.setattr(socket, "getaddrinfo", two_addresses)
    assert marks(Address.parse("tcp://chamber:502")) == {"port 502 of 10.0.0.1", "port 502 of 2001:db8::1"}


def test_a_serial_port_is_its_device_whatever_link_leads_there(tmp_path: Path) -> None:
    near, far = pty.openpty()
    (tmp_path / "by-id").symlink_to(os.ttyname(far))
    os.link(tmp_path / "by-id", tmp_path / "by-path", follow_symlinks=False)
    with hold(f"serial://{os.ttyname(far)}?baud=9600"):
        for link in ("by-id", "by-path"):
            assert "is in use by somebody" in refused(f"slcan://{tmp_path}/{link}")
    os.close(near)
    os.close(far)


def test_a_can_bus_is_the_same_from_every_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with hold("can:socketcan/can0?bitrate=500000"):
        monkeypatch.chdir(tmp_path)
        assert "is in use" in refused("can:socketcan/can0")


def test_what_two_programs_cannot_both_drive_is_not_held() -> None:
    with hold(HOST), hold(f"tcp://10.0.0.1:{PORT + 1}", f"sim+{HOST}"):
        pass
    with hold("person:operator", "log:bus.blf"), hold("person:operator", "log:bus.blf"):
        pass


def test_instruments_that_share_a_line_are_held_together() -> None:
    with hold("serial:///dev/itb-none?baud=9600", "serial:///dev/itb-none?baud=19200"):
        pass


def test_what_was_held_before_a_refusal_is_let_go() -> None:
    with hold(HOST):
        with pytest.raises(InUseError), hold(f"tcp://10.0.0.1:{PORT - 1}", HOST):
            pass
        with hold(f"tcp://10.0.0.1:{PORT - 1}"):
            pass
    with hold(HOST):
        pass


@pytest.mark.parametrize("change", [{"XDG_RUNTIME_DIR": "/run/user/4711"}, {"XDG_RUNTIME_DIR": ""}, {"TMPDIR": "/"}])
def test_another_process_is_named_whatever_its_environment_and_its_death_lets_go(change: dict[str, str]) -> None:
    with another(HOST, environment=os.environ | change) as process:
        assert f"by a run of smoke, process {process}. Wait until it has ended" in refused(HOST)
    with hold(HOST):
        pass


@pytest.mark.skipif(os.getuid() != 0, reason="only the administrator becomes another user")
def test_another_user_is_named() -> None:
    with another(HOST, NOBODY) as process:
        assert f"by a run of smoke, process {process} of user nobody." in refused(HOST)


def test_an_owner_that_stands_still_is_named_soon() -> None:
    with another(HOST) as process:
        stop(process)
        began_s = time.monotonic()
        assert f"by a program that does not answer, process {process}." in refused(HOST)
        assert time.monotonic() - began_s < 1.5
