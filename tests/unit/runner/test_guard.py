"""The run's end of its guardian."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.runner.guard import UNREAD_BYTES, Guard, _send_heartbeats
from bench.runner.signals import Signals


class Writer:
    """A record of which nothing waits for the disk."""

    commits = (0, False)


@pytest.fixture
def link():
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_BYTES)
    near.setblocking(False)
    with near, far:
        yield near, far


@pytest.fixture
def stopped():
    """A process that was stopped, as a guardian may be by hand."""
    with subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE) as process:
        os.kill(process.pid, signal.SIGSTOP)
        os.waitpid(process.pid, os.WUNTRACED)
        yield process
        process.kill()


def state_of(process):
    with open(f"/proc/{process.pid}/stat", encoding="ascii") as file:
        return file.read().rpartition(")")[2].split()[0]


def test_a_guardian_that_takes_no_beats_is_told_to_go_on_and_then_ends_the_run(link, stopped):
    signals, took = Signals(), []

    async def main():
        await _send_heartbeats(link[0], stopped.pid, signals, Guard(), Writer())
        took.append(asyncio.get_running_loop().time())

    run(main(), AS_FAST_AS_POSSIBLE)
    assert [sent.request.text for sent in signals.received] == [
        "its guardian hangs; nothing would make the bench safe if this process died"
    ]
    assert 15 < took[0] < 30
    for _ in range(100):
        if state_of(stopped) != "T":
            break
        time.sleep(0.01)
    assert state_of(stopped) != "T"


def test_a_guardian_that_takes_them_late_does_not(link, stopped):
    signals = Signals()

    async def late():
        for _ in range(6):
            await asyncio.sleep(18)
            link[1].setblocking(False)
            while True:
                try:
                    link[1].recv(16)
                except BlockingIOError:
                    break

    async def main():
        beating = asyncio.create_task(_send_heartbeats(link[0], stopped.pid, signals, Guard(), Writer()))
        await late()
        beating.cancel()

    run(main(), AS_FAST_AS_POSSIBLE)
    assert signals.received == []
