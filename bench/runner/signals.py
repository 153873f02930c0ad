"""What this process is told by signals while a run is under way, from its first device to its exit code.

SIGINT ends the step, and a second one drops the teardown; every other signal that would end the process drops it at
once, and the devices are made safe. None of them ends the process: it ends when the run is over and recorded. A signal
that is ignored when the process begins, as SIGHUP is under `nohup`, stays ignored.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Self

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
OF_FAULTS = {  # of the program itself, which cannot go on; its guardian takes over
    signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV, signal.SIGSYS, signal.SIGTRAP,
}  # fmt: skip
HARMLESS = {  # the last two in Python, which ignores them
    signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH, signal.SIGPIPE, signal.SIGXFSZ,
}  # fmt: skip
STOPPING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)  # would stop the process, with the bench as it is
ENDING = sorted(
    signal.valid_signals() - OF_FAULTS - HARMLESS - {*STOPPING, signal.SIGKILL, signal.SIGSTOP}
)  # would end the process


@dataclass(frozen=True)
class Sent:
    """A request to end the run: a signal, or one of this process itself; `gentle` leaves time for the teardown."""

    name: str
    request: EndRequest
    gentle: bool = False


class Dropped(BaseException):
    """A signal came while something was done that is not worth waiting for."""


class Signals:
    """The signals of this process while it is entered; outside the main thread none.

    Those that came are `received`. `told_to` gives them to whoever can act on them at the time, in the running loop.
    """

    def __init__(self) -> None:
        self.received: list[Sent] = []
        self._act: Callable[[Sent], object] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._raises = False
        self._before: dict[int, Any] = {}
        self._blocked: set[int] = set()

    def __enter__(self) -> Self:
        """Take the signals over."""
        try:
            for number in (*ENDING, *STOPPING):
                before = signal.getsignal(number)
                if before is not signal.SIG_IGN:
                    self._before[number] = before
                    signal.signal(number, signal.SIG_IGN if number in STOPPING else self._came)
            self._blocked = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)  # whoever began us may have blocked them
        except ValueError:  # not the main thread
            self._before.clear()
        return self

    def __exit__(self, *exc: object) -> None:
        """Let them do again what they did before."""
        for number, before in self._before.items():
            signal.signal(number, before)
        if self._before:
            signal.pthread_sigmask(signal.SIG_SETMASK, self._blocked)
        self._before.clear()

    @property
    def first(self) -> EndRequest | None:
        """Who ended the run first; None as long as nobody has."""
        return self.received[0].request if self.received else None

    @contextmanager
    def told_to(self, act: Callable[[Sent], object]) -> Iterator[None]:
        """While inside, `act` is called in the running loop for each signal that comes."""
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
        """While inside, a signal raises Dropped; at once when more have come already than `before`."""
        if len(self.received) > before:
            raise Dropped
        self._raises = True
        try:
            yield
        finally:
            self._raises = False

    @contextmanager
    def not_waiting(self) -> Iterator[None]:
        """While inside, a signal ends what is done, such as output that nobody takes, and nothing else."""
        try:
            with self.dropping(len(self.received)):
                yield
        except Dropped:
            pass

    def _came(self, number: int, _frame: FrameType | None) -> None:
        """Runs in the main thread between any two instructions."""
        name = _name(number)
        text = TEXTS.get(number, ("signal", f"ended by {name}, which another program sent"))
        self.tell(Sent(name, EndRequest(*text), number == signal.SIGINT))

    def tell(self, sent: Sent) -> None:
        """End the run as a signal does."""
        self.received.append(sent)
        if self._loop is not None and self._act is not None:
            self._loop.call_soon_threadsafe(self._act, sent)
        elif self._raises:
            self._raises = False
            raise Dropped


def _name(number: int) -> str:
    """Most real-time signals have no name of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"SIGRTMIN+{number - signal.SIGRTMIN}"
