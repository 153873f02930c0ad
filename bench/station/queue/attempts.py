"""Attempts at a run: the process of a run and its folder, which outlive the station.

The station writes what is to be run into a new folder and starts a process, which claims the folder and locks it as
long as it lives. So a station that starts again finds out what became of it: a claim can be made once, and a lock is
free when its process is dead.
"""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, NoReturn

from bench.errors import InputError, StoreError
from bench.files import is_locked, make_folder, sync_folder, write_atomically

COMMAND, CLAIM, LOCK = "command.json", "claim", "lock"
OUTPUT, MESSAGES = "stdout.txt", "stderr.txt"
SHOWN_BYTES = 4000  # of its messages
_WITHDRAWN = "withdrawn"
_TRIES, _BETWEEN_TRIES_S = 100, 0.02
_pause = threading.Event().wait


class Attempt(NamedTuple):
    """State of an attempt: its process lives, or has begun and is over, or has not begun."""

    lives: bool
    has_begun: bool
    messages: str


Launcher = Callable[[Path], None]
"""Starter of the process of an attempt in a folder, which outlives this process. Raises StoreError."""


def prepare(folder: Path, words: Sequence[str], working_folder: Path) -> None:
    """Create the folder of an attempt for the command `bench WORDS`. Raises StoreError."""
    try:
        make_folder(folder)
    except OSError as problem:
        raise StoreError(f"{folder}: cannot be created ({problem})") from problem
    write_atomically(folder / COMMAND, json.dumps({"words": list(words), "folder": str(working_folder)}).encode())


def as_subprocess(folder: Path) -> None:
    """Start the process of an attempt in a session of its own, as a child of the system. Raises StoreError."""
    try:
        subprocess.run(  # noqa: S603  our own command
            ["setsid", "--fork", sys.executable, "-m", "bench", "attempt", str(folder)],  # noqa: S607  of util-linux
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=30, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError) as problem:
        raise StoreError(f"the process of the run cannot be started ({problem})") from problem


def as_service(folder: Path) -> None:
    """Start the process of an attempt as a service of systemd, `bench-item@ITEM-ATTEMPT`. Raises StoreError."""
    unit = f"bench-item@{folder.parent.name}-{folder.name}.service"
    try:
        done = subprocess.run(  # noqa: S603  the names are ours
            ["systemctl", "start", "--no-block", unit],  # noqa: S607
            capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise StoreError(f"{unit} cannot be started ({problem})") from problem
    if done.returncode:
        raise StoreError(f"{unit} cannot be started: {done.stderr.strip()[-300:]}")


LAUNCHERS: Mapping[str, Launcher] = {"process": as_subprocess, "service": as_service}


def claim(folder: Path) -> bool:
    """Claim an attempt, durably, for the process that is to make it; False if it was claimed or withdrawn before."""
    return _claimed(folder, f"{os.getpid()}")


def withdraw(folder: Path) -> bool:
    """Make sure that an attempt never begins; False if it was claimed before. Raises OSError."""
    make_folder(folder)  # a station that was killed may not have prepared it yet
    return _claimed(folder, _WITHDRAWN)


def _claimed(folder: Path, by: str) -> bool:
    try:
        file = os.open(folder / CLAIM, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o600)
    except FileExistsError:
        return False
    with os.fdopen(file, "w") as claimed:
        claimed.write(by)
        claimed.flush()
        os.fsync(claimed.fileno())
    sync_folder(folder)
    return True


def look(folder: Path) -> Attempt:
    """Return the state of an attempt, from its folder alone."""
    lives = is_locked(folder / LOCK)
    begun = ""
    with suppress(OSError):
        begun = (folder / CLAIM).read_text("ascii", errors="replace")
    return Attempt(lives, bool(begun) and begun != _WITHDRAWN, _tail(folder / MESSAGES))


def make(folder: Path) -> NoReturn:
    """Make an attempt: lock and claim its folder, then turn this process into that of its command.

    The lock stays with the process. Raises InputError if it was claimed before, or if the folder holds none.
    """
    try:
        content = json.loads((folder / COMMAND).read_bytes())
        words, working_folder = [str(word) for word in content["words"]], str(content["folder"])
        lock = os.open(folder / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
        try:
            _take(lock)
            if not claim(folder):
                raise InputError(f"{folder}: this attempt was made or withdrawn before")
            for name, number in ((OUTPUT, 1), (MESSAGES, 2)):
                file = os.open(folder / name, os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600)
                os.dup2(file, number)
                os.close(file)
            os.set_inheritable(lock, True)
            os.chdir(working_folder)
            os.execv(sys.executable, [sys.executable, "-m", "bench", *words])  # noqa: S606  our own command
        finally:
            os.close(lock)  # it was not made
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise InputError(f"{folder}: holds no attempt that can be made ({problem})") from problem


def _take(lock: int) -> None:
    """Take the lock; a station that looks holds it for a moment. Raises BlockingIOError if another attempt has it."""
    for _ in range(_TRIES):
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        _pause(_BETWEEN_TRIES_S)
    raise BlockingIOError("it is under way in another process")


def _tail(path: Path) -> str:
    """Return the last part of a text file, without control characters; "" if there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - SHOWN_BYTES))
            text = file.read(SHOWN_BYTES).decode(errors="replace")
    except OSError:
        return ""
    return "".join(letter for letter in text if letter.isprintable() or letter == "\n").strip()
