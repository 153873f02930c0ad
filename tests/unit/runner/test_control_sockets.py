"""The control sockets under floods: who stops is heard, and who cannot be served is refused at once."""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from bench.errors import InputError
from bench.runner import control
from bench.runner import tell as tell_module
from bench.runner.control import Arguments, control_socket, socket_address
from bench.runner.held import peer
from bench.runner.tell import send_command
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
Handler = Callable[[Arguments], Awaitable[str]]
ASK_AS_ANOTHER = """
import os, socket, sys
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as client:
    client.connect(sys.argv[1].replace("@", chr(0), 1))
    sys.stdout.write(client.makefile("r").readline())
"""


class Run:
    """A run as its control sockets see it: a loop in a thread that carries out commands."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.commands: list[tuple[str, str]] = []
        self.hold = threading.Event()  # `wait` is not answered before
        self.waiting = threading.Semaphore(0)  # one more for each `wait` that has begun

    @contextmanager
    def under_way(self) -> Iterator[None]:
        begun, over = threading.Event(), threading.Event()

        async def main() -> None:
            with control_socket(self.folder, {"abort": self.abort, "status": self.status, "wait": self.wait}):
                begun.set()
                while not over.is_set():  # noqa: ASYNC110  set by another thread
                    await asyncio.sleep(0.01)

        thread = threading.Thread(target=asyncio.run, args=(main(),))
        thread.start()
        try:
            assert begun.wait(10)
            yield
        finally:
            self.hold.set()
            over.set()
            thread.join()

    async def abort(self, message: Arguments) -> str:
        self.commands.append(("abort", message["by"]))
        return "aborted"

    async def status(self, _: Arguments) -> str:
        return "x" * 2000

    async def wait(self, _: Arguments) -> str:
        hold = self.hold
        self.waiting.release()
        while not hold.is_set():  # noqa: ASYNC110  set by another thread
            await asyncio.sleep(0.01)
        return "waited"

    def connected(self, key: str = "socket") -> socket.socket:
        name = json.loads((self.folder / "runner.json").read_text("utf-8"))[key]
        client = socket.socket(socket.AF_UNIX)
        client.settimeout(5)
        for _ in range(100):
            try:
                client.connect(socket_address(name))
                return client
            except BlockingIOError:  # as many wait there as can
                time.sleep(0.01)
        raise AssertionError("nobody is let in")

    def asked(self, line: bytes, key: str = "socket") -> dict[str, str]:
        with self.connected(key) as client:
            with suppress(BrokenPipeError):  # refused at once
                client.sendall(line)
            return json.loads(client.makefile("rb").readline())


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    found = Run(tmp_path)
    with found.under_way():
        yield found


def test_who_aborts_is_heard_at_once_among_many_who_poll_and_many_who_say_nothing(run: Run) -> None:
    over = threading.Event()

    def poll() -> None:
        while not over.is_set():
            send_command(run.folder, "status")

    pollers = [threading.Thread(target=poll) for _ in range(10)]
    with ExitStack() as idle:
        for key in ("socket", "stop"):
            for _ in range(control.CONNECTIONS + 20):
                idle.enter_context(run.connected(key))
        for poller in pollers:
            poller.start()
        began_s = time.monotonic()
        assert send_command(run.folder, "abort") == "aborted"
        took_s = time.monotonic() - began_s
        over.set()
        for poller in pollers:
            poller.join()
    assert took_s < 1.0
    assert [command for command, _ in run.commands] == ["abort"]


def test_who_aborts_does_not_wait_for_another_command(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "ANSWER_S", 1.0)
    with run.connected() as client:
        client.sendall(b'{"command": "wait"}\n')
        assert run.waiting.acquire(timeout=10)
        assert send_command(run.folder, "abort") == "aborted"
        assert run.commands
        run.hold.set()
        assert json.loads(client.makefile("rb").readline()) == {"done": "waited"}


def test_a_line_that_trickles_in_is_refused_at_its_deadline(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "REQUEST_S", 0.3)
    began_s = time.monotonic()
    with run.connected() as client:
        client.settimeout(0.1)
        for _ in range(20):
            try:
                client.send(b" ")
            except BrokenPipeError:  # its answer is there
                client.settimeout(5)
            try:
                answer = json.loads(client.recv(4096))
                break
            except TimeoutError:
                continue
    assert answer == {"refused": "no complete line within 0.3 s"}
    assert 0.25 < time.monotonic() - began_s < 1.0


def test_who_cannot_be_served_is_refused_at_once_and_who_has_not_asked_gives_way(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control, "CONNECTIONS", 3)
    with ExitStack() as connected:
        waiting = [connected.enter_context(run.connected()) for _ in range(3)]
        for client in waiting[:2]:
            client.sendall(b'{"command": "wait"}\n')
        time.sleep(0.2)
        client = connected.enter_context(run.connected())  # the third has said nothing
        assert json.loads(waiting[2].makefile("rb").readline()) == control.BUSY
        client.sendall(b'{"command": "wait"}\n')
        time.sleep(0.2)
        assert run.asked(b"") == control.BUSY
        run.hold.set()
        for each in (*waiting[:2], client):
            assert json.loads(each.makefile("rb").readline()) == {"done": "waited"}


def test_who_is_refused_before_he_asks_reads_why_and_asks_again(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "CONNECTIONS", 0)
    met = 0

    def late(client: socket.socket) -> tuple[int, int]:
        nonlocal met
        met += 1
        if met == 1:  # what it is to send comes after its answer and the end of the connection
            assert select.select([client], [], [], 5)[0]
            time.sleep(0.1)
            monkeypatch.setattr(control, "CONNECTIONS", 3)
        return peer(client)

    monkeypatch.setattr(tell_module, "peer", late)
    assert send_command(run.folder, "abort") == "aborted"
    assert met == 2


def test_the_socket_for_stopping_does_nothing_else(run: Run) -> None:
    assert run.asked(b'{"command": "status"}\n', "stop") == {"refused": "expected one of abort"}
    assert run.asked(b'{"command": "abort", "by": "A. Person"}\n', "socket") == {"done": "aborted"}
    assert run.commands == [("abort", "A. Person")]


@pytest.mark.skipif(os.getuid() != 0, reason="only the administrator becomes another user")
def test_another_user_is_refused(run: Run) -> None:
    names = json.loads((run.folder / "runner.json").read_text("utf-8"))
    for key in ("socket", "stop"):
        asked = [sys.executable, "-c", ASK_AS_ANOTHER, names[key]]
        reported = subprocess.run(asked, capture_output=True, check=True, cwd=ROOT).stdout
        assert json.loads(reported) == {"refused": "this run belongs to another user"}


@pytest.mark.skipif(os.getuid() != 0, reason="only the administrator gives files away")
def test_a_program_of_another_user_in_the_place_of_a_run_is_not_told(run: Run) -> None:
    os.chown(run.folder / "runner.json", 65534, -1)
    with (run.folder / "run.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="the socket belongs to a program of another user"):
            send_command(run.folder, "abort")
    assert run.commands == []


def test_what_is_under_way_when_the_run_ends_is_answered(tmp_path: Path) -> None:
    found = Run(tmp_path)
    with ExitStack() as connected:
        with found.under_way():
            silent = connected.enter_context(found.connected())  # accepted before the next one
            client = connected.enter_context(found.connected())
            client.sendall(b'{"command": "wait"}\n')
            assert found.waiting.acquire(timeout=10)
            found.hold = threading.Event()  # nobody sets the one that the command waits for
        for each in (client, silent):
            assert json.loads(each.makefile("rb").readline()) == {"refused": "the run is about to end"}
