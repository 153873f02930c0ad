"""Signals of the process from the first device to the exit code of a run.

SIGINT ends the step, and a second one skips the teardown; every other signal that would end the process skips it at
once, and the devices are made safe. None of them ends the process: it ends when the run is over and recorded. A signal
that is ignored when the process starts, as SIGHUP is under `nohup`, stays ignored.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NamedTuple, Self

from bench.engine.ending import EndRequest
from bench.loop import BenchLoop

TEXTS: dict[int, tuple[str, str]] = {
    signal.SIGINT: ("interrupt", "ended by the operator with Ctrl-C"),
    signal.SIGQUIT: ("quit", "ended by the operator with Ctrl-\\"),
    signal.SIGTERM: ("terminate", "ended by SIGTERM: another program, or the shutdown of the computer"),
    signal.SIGHUP: ("hang-up", "ended by SIGHUP: the terminal was closed, or the connection to it was lost"),
    signal.SIGXCPU: ("limit", "ended by SIGXCPU: the process has used all its allowed processor time"),
    signal.SIGPWR: ("power", "ended by SIGPWR: the power of the computer fails"),
}
OF_FAULTS = {  # of the program itself, which cannot continue; its guardian takes over
    signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGSYS, signal.SIGTRAP,
}  # fmt: skip
HARMLESS = {  # the last two in Python, which ignores them
    signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH, signal.SIGPIPE, signal.SIGXFSZ,
}  # fmt: skip
STOPPING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)  # would suspend the process and leave the bench as it is
ENDING = sorted(
    signal.valid_signals() - OF_FAULTS - HARMLESS - {*STOPPING, signal.SIGKILL, signal.SIGSTOP}
)  # would end the process


class EndSignal(NamedTuple):
    """Request to end the run, by a signal or by this process itself; `gentle` allows the teardown."""

    name: str
    request: EndRequest
    gentle: bool = False


class Dropped(BaseException):
    """Raised by a signal during an operation that is not worth waiting for."""


class Signals:
    """Signal handlers of this process within the context; no effect outside the main thread.

    Signals are collected in `received`. `calling` passes them to a function in the running loop.
    """

    def __init__(self) -> None:
        self.received: list[EndSignal] = []
        self._act: Callable[[EndSignal], object] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._raises = False
        self._before: dict[int, Any] = {}
        self._blocked: set[int] = set()

    def __enter__(self) -> Self:
        """Install the handlers."""
        try:
            for number in (*ENDING, *STOPPING):
                before = signal.getsignal(number)
                if before is not signal.SIG_IGN:
                    self._before[number] = before
                    signal.signal(number, signal.SIG_IGN if number in STOPPING else self._handle)
            # the parent process may have blocked them
            self._blocked = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        except ValueError:  # not the main thread
            self._before.clear()
        return self

    def __exit__(self, *exc: object) -> None:
        """Restore the previous handlers."""
        for number, before in self._before.items():
            signal.signal(number, before)
        if self._before:
            signal.pthread_sigmask(signal.SIG_SETMASK, self._blocked)
        self._before.clear()

    @property
    def first(self) -> EndRequest | None:
        """First request to end the run, or None."""
        return self.received[0].request if self.received else None

    @contextmanager
    def calling(self, act: Callable[[EndSignal], object]) -> Iterator[None]:
        """Call `act` in the running loop for each signal during the block."""
        loop = asyncio.get_running_loop()
        self._loop, self._act, before = loop, act, (self._loop, self._act)
        wakeup = None
        if self._before and isinstance(loop, BenchLoop):
            wakeup = signal.set_wakeup_fd(loop.wakeup_fd, warn_on_full_buffer=False)
        try:
            yield
        finally:
            self._loop, self._act = before
            if wakeup is not None:
                signal.set_wakeup_fd(wakeup)

    @contextmanager
    def dropping(self, before: int) -> Iterator[None]:
        """Raise Dropped on a signal during the block; at once if more than `before` have arrived already."""
        if len(self.received) > before:
            raise Dropped
        self._raises = True
        try:
            yield
        finally:
            self._raises = False

    @contextmanager
    def not_waiting(self) -> Iterator[None]:
        """End the block on a signal, such as output that nobody reads, without further effect."""
        try:
            with self.dropping(len(self.received)):
                yield
        except Dropped:
            pass

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        """Handle a signal; runs in the main thread between any two instructions."""
        name = _name(number)
        text = TEXTS.get(number, ("signal", f"ended by {name}, which another program sent"))
        self.request_end(EndSignal(name, EndRequest(*text), number == signal.SIGINT))

    def request_end(self, sent: EndSignal) -> None:
        """End the run as a signal does."""
        self.received.append(sent)
        if self._loop is not None and self._act is not None:
            self._loop.call_soon_threadsafe(self._act, sent)
        elif self._raises:
            self._raises = False
            raise Dropped


def _name(number: int) -> str:
    """Return the name of a signal; most real-time signals have none of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"SIGRTMIN+{number - signal.SIGRTMIN}"
