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
from contextlib import contextmanager, suppress

import pytest

from bench.guardian import watch as core
from bench.guardian.watch import BEAT_S, COMMIT_S, OVER, Counters, Lost, Over, beat, over, watch

RUNS = "import sys; sys.stdin.read()"
BEAT = beat(1, 0, {}, waits=False, may_hold=False)


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
        assert watch(far, pidfd) == Over()


@pytest.mark.parametrize("may_hold", [True, False])
def test_a_run_that_has_died_does(may_hold):
    with runner() as (process, pidfd, near, far):
        near.send(beat(1, 0, {}, waits=False, may_hold=may_hold))
        process.kill()
        near.close()
        assert watch(far, pidfd) == Lost("the process of the run has died", may_hold)


def test_a_link_that_is_reset_is_closed():
    with runner() as (process, pidfd, near, far):
        far.send(b"never read")
        process.kill()
        near.close()
        assert watch(far, pidfd) == Lost("the process of the run has died")


def test_one_that_has_died_and_whose_link_a_child_still_has_does_too():
    with runner() as (process, pidfd, near, far):
        near.send(beat(1, 0, {}, waits=False, may_hold=True))
        process.kill()
        assert watch(far, pidfd) == Lost("the process of the run has died", may_hold=True)


def test_one_that_lives_and_has_closed_its_link_does(monkeypatch):
    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    with runner() as (process, pidfd, near, far):
        near.close()
        assert watch(far, pidfd) == Lost("the run has closed the link to its guardian, and its process goes on")
        assert process.poll() is None


def test_a_silent_one_is_killed_and_not_before():
    with runner() as (process, pidfd, near, far):
        beating = threading.Timer(0.5, near.send, [BEAT])
        beating.start()
        begun_s = time.monotonic()
        assert watch(far, pidfd, 1.0) == Lost("the process of the run did not respond for 1 s and was killed")
        assert time.monotonic() - begun_s >= 1.4
        assert process.wait() == -signal.SIGKILL


def test_one_that_does_not_die_is_told_as_dangerous_in_time(monkeypatch):
    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    monkeypatch.setattr(core.signal, "pidfd_send_signal", lambda *_: None)
    with runner() as (_process, pidfd, _near, far):
        assert watch(far, pidfd, 0.3) == Lost(
            "the process of the run did not respond for 0.3 s and was killed, but does not end: "
            "it may still send commands"
        )


def test_one_that_ends_by_itself_meanwhile_needs_no_killing(monkeypatch):
    def gone(*_arguments: object) -> None:
        raise ProcessLookupError

    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    monkeypatch.setattr(core.signal, "pidfd_send_signal", gone)
    with runner() as (_process, pidfd, _near, far):
        assert watch(far, pidfd, 0.3).why.startswith("the process of the run did not respond for 0.3 s")


def test_silence_counts_only_while_the_guardian_ticks(monkeypatch):
    ticks: list[float] = []

    def slow(read: list[object], _write: object, _bad: object, limit_s: float) -> tuple[list[object], ...]:
        ticks.append(limit_s)
        time.sleep(0.02)  # on a computer that stands still a tick takes any time
        return ([], [], []) if len(ticks) < 5 else ([read[0]], [], [])

    monkeypatch.setattr(core.select, "select", slow)
    with runner() as (_process, pidfd, near, far):
        near.send(OVER)
        assert watch(far, pidfd, 5 * core.TICK_S) == Over()


@pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"nonsense", b"beat " + b"[" * 4000])
def test_no_message_is_taken_for_an_end(content, monkeypatch):
    monkeypatch.setattr(core, "DIE_WITHIN_S", 0.1)
    with runner() as (_process, pidfd, near, far):
        near.send(content) if content else near.close()
        assert isinstance(watch(far, pidfd, 0.5), Lost)


def test_how_a_bench_was_left_comes_with_the_end():
    with runner() as (_process, pidfd, near, far):
        near.send(over(Over(("supply",), ("chamber",))))
        assert watch(far, pidfd) == Over(("supply",), ("chamber",))


def test_beats_of_a_loop_that_does_not_turn_are_silence():
    with runner() as (process, pidfd, near, far):
        stop = threading.Event()

        def beat_on():
            while not stop.wait(0.05):
                near.send(BEAT)

        beating = threading.Thread(target=beat_on)
        beating.start()
        begun_s = time.monotonic()
        try:
            assert "did not respond for 1 s" in watch(far, pidfd, 1.0).why
            assert time.monotonic() - begun_s >= 0.95
        finally:
            stop.set()
            beating.join()
        assert process.wait() == -signal.SIGKILL


def counted(limits_s, polls, *, waits=False, commits=lambda n: 0):
    """The alarms of beats of so many polls each, and why the run is to be killed."""
    alarms: list[str] = []
    counters = Counters(limits_s, alarms.append)
    for turns, count in enumerate(polls):
        counters.take(beat(turns, commits(turns), count, waits=waits, may_hold=False))
    return alarms, counters.stuck


def test_polls_that_stand_still_are_an_alarm_and_after_twice_the_time_the_end():
    beats = int(10 / BEAT_S)
    assert counted({"head": 10.0}, [{"head": 7}] * beats) == ([], "")
    alarms, stuck = counted({"head": 10.0}, [{"head": 7}] * (beats + 3))
    assert alarms == ["head was not polled for 10.5 s, while the event loop of the run is running"]
    assert stuck == ""
    alarms, stuck = counted({"head": 10.0}, [{"head": 7}] * (2 * beats + 2))
    assert len(alarms) == 1
    assert stuck == "head was not polled for 20.5 s; the process of the run was killed"


def test_polls_that_advance_or_are_none_are_never_late():
    many = int(100 / BEAT_S)
    assert counted({"head": 10.0}, [{"head": n // 15} for n in range(many)]) == ([], "")
    assert counted({"head": 10.0}, [{}] * many) == ([], "")


def test_a_disk_that_does_not_answer_is_an_alarm_and_never_the_end():
    many = int(10 * COMMIT_S / BEAT_S)
    alarms, stuck = counted({}, [{}] * many, waits=True)
    assert len(alarms) == 1
    assert alarms[0].startswith("nothing was committed to the disk for 30.5 s")
    assert stuck == ""
    assert counted({}, [{}] * many, waits=False) == ([], "")
    assert counted({}, [{}] * many, waits=True, commits=lambda n: n // 20) == ([], "")


def test_a_run_whose_instrument_is_not_polled_is_killed():
    with runner() as (process, pidfd, near, far):
        near.setblocking(False)
        stop = threading.Event()

        def beat_on():
            for turns in range(10_000):
                if stop.wait(0.002):
                    return
                with suppress(BlockingIOError):  # a guardian that has seen enough reads no more
                    near.send(beat(turns, 0, {"supply": 3}, waits=False, may_hold=True))

        beating = threading.Thread(target=beat_on)
        beating.start()
        try:
            lost = watch(far, pidfd, polls_within_s={"supply": 5.0})
        finally:
            stop.set()
            beating.join()
        assert lost == Lost("supply was not polled for 10.5 s; the process of the run was killed", may_hold=True)
        assert process.wait() == -signal.SIGKILL
