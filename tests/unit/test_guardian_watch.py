"""The supervising core of a guardian: death, silence and the end of a run."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from bench.guardian import watch as core
from bench.guardian.watch import BEAT, OVER, watch

RUNS = "import sys; sys.stdin.read()"


@contextmanager
def runner() -> Iterator[tuple[subprocess.Popen[bytes], int, socket.socket, socket.socket]]:
    """A process that stands for a run: itself, its pidfd, and both ends of its link."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with near, far, subprocess.Popen([sys.executable, "-c", RUNS], stdin=subprocess.PIPE) as process:
        pidfd = os.pidfd_open(process.pid)
        try:
            yield process, pidfd, near, far
        finally:
            os.close(pidfd)
            process.kill()


def test_a_run_that_is_over_needs_no_rescue():
    with runner() as (process, pidfd, near, far):
        near.send(BEAT)
        near.send(OVER)
        process.kill()
        process.wait()
        assert watch(far, pidfd) is None


def test_a_run_that_has_died_does():
    with runner() as (process, pidfd, near, far):
        near.send(BEAT)
        process.kill()
        near.close()
        assert watch(far, pidfd) == "the process of the run has died"


def test_one_that_has_died_and_whose_link_a_child_still_has_does_too():
    with runner() as (process, pidfd, _near, far):
        process.kill()
        assert watch(far, pidfd) == "the process of the run has died"


def test_one_that_lives_and_has_closed_its_link_does(monkeypatch):
    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    with runner() as (process, pidfd, near, far):
        near.close()
        assert watch(far, pidfd) == "the run has closed the link to its guardian, and its process goes on"
        assert process.poll() is None


def test_a_silent_one_is_killed_and_not_before():
    with runner() as (process, pidfd, near, far):
        beating = threading.Timer(0.5, near.send, [BEAT])
        beating.start()
        begun_s = time.monotonic()
        assert watch(far, pidfd, 1.0) == "the process of the run stood still for 1 s and was killed"
        assert time.monotonic() - begun_s >= 1.4
        assert process.wait() == -signal.SIGKILL


def test_silence_counts_only_while_the_guardian_ticks(monkeypatch):
    ticks: list[float] = []

    def slow(read: list[object], _write: object, _bad: object, limit_s: float) -> tuple[list[object], ...]:
        ticks.append(limit_s)
        time.sleep(0.02)  # on a computer that stands still a tick takes any time
        return ([], [], []) if len(ticks) < 5 else ([read[0]], [], [])

    monkeypatch.setattr(core.select, "select", slow)
    with runner() as (_process, pidfd, near, far):
        near.send(OVER)
        assert watch(far, pidfd, 5 * core.TICK_S) is None


@pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"nonsense"])
def test_no_message_is_taken_for_an_end(content, monkeypatch):
    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    with runner() as (_process, pidfd, near, far):
        near.send(content) if content else near.close()
        assert watch(far, pidfd, 0.5) is not None
