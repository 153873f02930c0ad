"""Signals while a run is under way."""

import asyncio
import os
import signal
import subprocess

import pytest

from bench.loop import run
from bench.runner.signals import ENDING, STOPPING, Signals

OF_FAULTS = {
    signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGSYS, signal.SIGTRAP,
}  # fmt: skip
IGNORED_BY_PYTHON = {signal.SIGPIPE, signal.SIGXFSZ}


def ends_by_default(number):
    done = subprocess.run(
        ["sh", "-c", f"kill -{number} $$"], check=False, preexec_fn=lambda: signal.signal(number, signal.SIG_DFL)
    )
    return done.returncode == -number


@pytest.mark.lengthy
def test_every_signal_that_ends_a_process_is_taken_but_those_of_its_own_faults():
    tried = signal.valid_signals() - {*STOPPING, signal.SIGKILL, signal.SIGSTOP}
    assert set(ENDING) == {number for number in tried if ends_by_default(number)} - OF_FAULTS - IGNORED_BY_PYTHON


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_is_told_with_its_name(number):
    reported = []

    async def wait_for_it():
        came = asyncio.Event()
        with signals.calling(lambda sent: (reported.append(sent), came.set())):
            os.kill(os.getpid(), number)
            await came.wait()

    before = signal.signal(number, signal.SIG_DFL)  # whoever began the tests may ignore it
    with Signals() as signals:
        run(wait_for_it())
    signal.signal(number, before)
    assert reported[0].name.startswith("SIG")
    assert reported[0].name in reported[0].request.text or number in (signal.SIGINT, signal.SIGQUIT)
    assert reported[0].gentle is (number == signal.SIGINT)


def test_a_signal_that_is_blocked_when_the_process_begins_comes_all_the_same():
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    handler = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with Signals() as signals:
            os.kill(os.getpid(), signal.SIGTERM)
            assert [sent.name for sent in signals.received] == ["SIGTERM"]
        assert signal.SIGTERM in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGTERM, handler)
