"""The process that follows chambers after a run: its signals, streams and file descriptors."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

from bench.guardian.follow import Following, end_on_sigterm, in_own_process

FILE = "followed.jsonl"


def test_a_signal_ends_the_supervision(sent):
    before = signal.getsignal(signal.SIGTERM)
    try:
        end_on_sigterm(sent)
        os.kill(os.getpid(), signal.SIGTERM)
        assert sent._ends.is_set()
    finally:
        signal.signal(signal.SIGTERM, before)
    sent.close()


class InChild:
    """A supervision that writes what it finds about its process, and ends when it is told to."""

    def __init__(self, path: Path, entered: list[str]) -> None:
        self._path, self._found, self._ends = path, entered, threading.Event()

    def __enter__(self) -> InChild:
        self._found.append("entered")
        return self

    def __exit__(self, *_exc: object) -> None:
        with self._path.open("a") as file:
            file.write("\nleft")

    def end(self) -> None:
        self._ends.set()

    def follow(self) -> None:
        streams = [os.readlink(f"/proc/self/fd/{number}") for number in (0, 1, 2)]
        found = [os.getpid(), os.getsid(0), *streams, pipes(), *self._found]
        draft = self._path.with_suffix(".draft")
        draft.write_text(" ".join(map(str, found)))
        draft.rename(self._path)
        if self._ends.wait(10):
            with self._path.open("a") as file:
                file.write("\nasked to end")

    @staticmethod
    def _is_pipe(name: str) -> bool:
        return os.path.islink(f"/proc/self/fd/{name}") and os.readlink(f"/proc/self/fd/{name}").startswith("pipe")


def awaited(path: Path) -> list[str]:
    for _ in range(500):
        if path.exists():
            break
        threading.Event().wait(0.01)
    return path.read_text().split()


def pipes() -> int:
    return sum(map(InChild._is_pipe, os.listdir("/proc/self/fd")))


def test_a_process_of_its_own_follows_without_terminal_and_link(tmp_path):
    path, before = tmp_path / "child", pipes()
    in_own_process(lambda: InChild(path, []))
    process, session, *found = awaited(path)
    assert int(process) != os.getpid()
    assert session == process
    assert found == ["/dev/null", "/dev/null", "/dev/null", str(before), "entered"]
    os.kill(int(process), signal.SIGTERM)
    _, status = os.waitpid(int(process), 0)
    assert status == 0
    assert path.read_text().splitlines()[1:] == ["asked to end", "left"]
    assert pipes() == before


def test_a_process_that_cannot_follow_is_not_waited_for(tmp_path):
    path = tmp_path / "child"

    def fails() -> Following:
        path.write_text(str(os.getpid()))
        raise RuntimeError

    in_own_process(fails)
    (process,) = awaited(path)
    _, status = os.waitpid(int(process), 0)
    assert status == 0
