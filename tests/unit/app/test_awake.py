"""Time in which this program did not run is nobody's silence."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bench.app import clock_record
from bench.engine.journal import Journal
from bench.loop import AS_FAST_AS_POSSIBLE, REAL_TIME, BenchLoop, run
from bench.store.reader import RunReader
from bench.store.writer import RunWriter
from drivers.errors import NoAnswer
from drivers.timing.awake import SLICE_S, Deadline, awake_s, fair_timeout, succeeded_within
from drivers.transport.exchange import LineExchange, Pace, SyncQuery
from tests.support.runs import ROOT

STANDS_S = 0.8  # longer than an answer may take
ANSWER_S = 0.3


def test_in_virtual_time_patience_ends_to_the_instant() -> None:
    async def main() -> float:
        with pytest.raises(TimeoutError):
            async with fair_timeout(2.5):
                await asyncio.sleep(60)
        return asyncio.get_running_loop().time()

    assert run(main(), AS_FAST_AS_POSSIBLE) == 2.5


def test_slices_count_as_what_was_asked_for() -> None:
    asked: list[float] = []
    assert not succeeded_within(lambda slice_s: asked.append(slice_s) is not None, 2.0)
    assert asked == [SLICE_S] * 8
    assert succeeded_within(lambda _slice_s: True, 1.0)


class Peer:
    """An instrument at the other end of a socket; it answers each question after `delay_s`, if any, when `awake`."""

    def __init__(self, delay_s: float | None) -> None:
        self.delay_s, self.awake = delay_s, threading.Event()
        self.awake.set()
        self.here, self._there = socket.socketpair()
        self.thread = threading.Thread(target=self._answer)
        self.thread.start()

    def _answer(self) -> None:
        with self._there:
            while self._there.recv(100):
                if self.delay_s is not None:
                    time.sleep(self.delay_s)
                    self.awake.wait()
                    self._there.send(b"answer\n")


def asked(peer: Peer, stands_after_s: float | None) -> bytes:
    """The answer to one question; the whole program stands still meanwhile, the instrument if it is not `awake`."""

    async def main() -> bytes:
        loop = asyncio.get_running_loop()

        def stand_still() -> None:
            time.sleep(STANDS_S)
            peer.awake.set()

        line = LineExchange("echo", SyncQuery(b"who?", bytes), pace=Pace(ANSWER_S))
        await loop.create_connection(lambda: line, sock=peer.here)
        if stands_after_s is not None:
            loop.call_later(stands_after_s, stand_still)
        try:
            return await line.query(b"what?", bytes)
        finally:
            line.close()

    try:
        return run(main(), REAL_TIME)
    finally:
        peer.thread.join()


@pytest.mark.integration
def test_an_answer_that_came_while_the_program_stood_still_is_taken() -> None:
    assert asked(Peer(0.05), 0.01) == b"answer"


@pytest.mark.integration
def test_an_instrument_that_stood_still_with_the_program_has_its_time_afterwards() -> None:
    peer = Peer(0.1)
    peer.awake.clear()
    assert asked(peer, 0.05) == b"answer"


@pytest.mark.integration
def test_a_silent_instrument_is_silent_after_its_time() -> None:
    peer = Peer(None)
    began_s = time.monotonic()
    with pytest.raises(NoAnswer):
        asked(peer, None)
    assert ANSWER_S <= time.monotonic() - began_s < ANSWER_S + 1.0


@pytest.mark.integration
def test_the_loop_knows_for_how_long_it_stood_still() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        await asyncio.sleep(0.05)
        began_s, deadline = loop.time(), Deadline(0.75)
        time.sleep(STANDS_S)  # noqa: ASYNC251  nothing of this program runs
        await asyncio.sleep(0.05)
        assert loop.stalled_since(began_s) == pytest.approx(STANDS_S, abs=0.2)
        assert awake_s(began_s) < 0.7  # it would be 0.85 if the standstill counted
        assert not deadline.passed
        assert loop.stalled_since(loop.time()) == 0
        await asyncio.sleep(0.9)
        assert deadline.passed

    run(main(), REAL_TIME)


STOPPED = """
import sys, threading
from bench.loop import run, REAL_TIME
from drivers.timing.awake import Deadline, succeeded_within
import asyncio

came = threading.Event()

def listen():
    sys.stdin.readline()
    came.set()

async def until_it_came():
    deadline = Deadline(1.0)
    while not came.is_set() and not deadline.passed:
        await asyncio.sleep(0.05)
    return came.is_set()

threading.Thread(target=listen, daemon=True).start()
print("waiting", flush=True)
print(run(until_it_came(), REAL_TIME) if sys.argv[1] == "loop" else succeeded_within(came.wait, 1.0), flush=True)
"""


@pytest.mark.integration
@pytest.mark.parametrize("who", ["loop", "thread"])
def test_a_process_that_was_stopped_waits_on(who: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", STOPPED, who], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        os.kill(process.pid, signal.SIGSTOP)
        time.sleep(1.3)
        os.kill(process.pid, signal.SIGCONT)
        time.sleep(0.1)
        process.stdin.write("\n")
        process.stdin.close()
        assert process.stdout.readline() == "True\n"


@pytest.mark.integration
def test_a_time_in_which_the_program_stood_still_is_in_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clock_record, "LOOK_EVERY_S", 0.2)
    message: list[str] = []

    async def main() -> None:
        writer = RunWriter(tmp_path)
        async with clock_record.ClockRecord(Journal(writer), message.append).watched():
            await asyncio.sleep(0.05)
            time.sleep(1.2)  # noqa: ASYNC251  nothing of this program runs
            await asyncio.sleep(0.4)
        writer.close()

    run(main(), REAL_TIME)
    with RunReader(tmp_path) as reader:
        (stalled,) = [event.data["for_s"] for event in reader.events("stalled")]
    assert 1.0 < stalled < 2.0
    assert message[0].startswith("This program was suspended for 1.")
