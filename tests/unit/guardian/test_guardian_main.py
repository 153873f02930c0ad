"""The process of a guardian, from its start to its end."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench.guardian import main as module
from bench.guardian import rescue
from bench.guardian.main import main
from bench.guardian.watch import ARMED, Lost, Over

IGNORED = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)


class Rescues:
    """What a guardian asks of its rescue."""

    polls_within_s: dict[str, float]

    def __init__(self, *arguments: object) -> None:
        self.arguments, self.did, self.is_safe = arguments, list[object](), True
        self.polls_within_s = {"head": 9.0}

    def alarm(self, why: str) -> None:
        self.did.append(why)

    def leave(self, end: Over) -> None:
        self.did.append(end)

    def make_safe(self, lost: Lost) -> bool:
        self.did.append(lost)
        return self.is_safe


class Started:
    """A guardian whose run is the parent of this process, and is over or lost as `end` says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, runner: int) -> None:
        self.near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._number, self._links = far.detach(), list[socket.socket]()
        self.end: Over | Lost = Over()
        self.rescues, self.watched, self._runner = list[Rescues](), list[Any](), runner
        self.is_safe = True
        monkeypatch.setattr(module, "socket", SimpleNamespace(socket=self._link))
        monkeypatch.setattr(module.os, "pidfd_open", lambda number: -number)
        monkeypatch.setattr(rescue, "Rescue", self._rescue)
        monkeypatch.setattr(module, "watch", self._watch)

    def _link(self, *, fileno: int) -> socket.socket:
        self._links.append(socket.socket(fileno=fileno))
        return self._links[-1]

    def _rescue(self, *arguments: object) -> Rescues:
        self.rescues.append(Rescues(*arguments))
        self.rescues[-1].is_safe = self.is_safe
        return self.rescues[-1]

    def _watch(self, link: socket.socket, runner: int, **options: Any) -> Over | Lost:
        self.watched.append((link.fileno() >= 0, runner, options["polls_within_s"]))
        options["alarm"]("late")
        return self.end

    def main(self) -> int:
        return main(str(self._number), str(self._runner), "/runs/a", "/bench.yaml", "abc")

    def close(self) -> None:
        """Close what the end of a guardian's process would."""
        for link in (self.near, *self._links):
            link.close()


@pytest.fixture
def started(monkeypatch):
    before = {number: signal.getsignal(number) for number in IGNORED}
    found = Started(monkeypatch, os.getppid())
    yield found
    found.close()
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_guardian_reports_that_it_watches(started):
    assert started.main() == 0
    assert started.near.recv(100) == ARMED
    (made,) = started.rescues
    assert made.arguments == (Path("/runs/a"), Path("/bench.yaml"), "abc", os.getppid())
    assert started.watched == [(True, -os.getppid(), {"head": 9.0})]
    assert made.did == ["late", Over()]
    assert all(signal.getsignal(number) is signal.SIG_IGN for number in IGNORED)


def test_a_run_that_is_over_is_left_after_its_link_is_closed(started, monkeypatch):
    closed: list[bytes] = []
    started.end = Over(("supply",), ())

    def leave(_self: object, _end: Over) -> None:
        closed.extend((started.near.recv(100), started.near.recv(100)))

    monkeypatch.setattr(Rescues, "leave", leave)
    assert started.main() == 0
    assert closed == [ARMED, b""]


@pytest.mark.parametrize(("is_safe", "code"), [(True, 0), (False, 6)])
def test_the_bench_of_a_run_that_is_lost_is_made_safe(started, is_safe, code):
    started.end, started.is_safe = Lost("it died", may_hold=True), is_safe
    assert started.main() == code
    assert started.rescues[0].did == ["late", Lost("it died", may_hold=True)]


def test_a_run_that_has_died_before_needs_no_guardian(started, monkeypatch):
    monkeypatch.setattr(module.os, "getppid", lambda: -1)  # another process has taken its place
    assert started.main() == 0
    assert started.rescues == []
    started.near.setblocking(False)
    with pytest.raises(BlockingIOError):
        started.near.recv(100)


def test_a_guardian_that_cannot_watch_says_why(started, monkeypatch):
    def fails(*_arguments: object) -> None:
        raise RuntimeError("no memory" + " " * 5000 + "left")

    monkeypatch.setattr(rescue, "Rescue", fails)
    assert started.main() == 2
    answer = started.near.recv(10_000)
    assert answer.startswith(b"cannot no memory ")
    assert len(answer) == 4096
    assert started.watched == []
