"""Two programs at one instrument: however its address is spelled, and whoever they belong to."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from bench.errors import InUseError
from bench.runner.held import address_lock
from campaigns.trials.rows import Row
from drivers.transport.address import Address
from tests.support.runs import ROOT
from tests.support.served import free_port

NOBODY = 65534
SPELLINGS = (
    "tcp://localhost:{}", "tcp://127.0.0.1:{}", "tcp://[::1]:{}", "tcp://[::ffff:127.0.0.1]:{}", "tcp://LOCALHOST:{}",
    "socket://127.1:{}",
)  # fmt: skip
HOLDS = """
import encodings.idna, os, sys
from bench.runner.held import address_lock
from drivers.transport.address import Address
os.setuid(int(sys.argv[2]))
with address_lock([Address.parse(sys.argv[1])], "a run of smoke"):
    print("held", flush=True)
    sys.stdin.read()
"""
ENVIRONMENTS: tuple[Mapping[str, str], ...] = ({}, {"XDG_RUNTIME_DIR": "/run/user/4711"}, {"TMPDIR": "/"})


def trials(scale: float) -> Iterator[Row]:
    """Every pair of spellings, of environments, of names of a port and of users; who has it is named each time."""
    few = scale < 0.5
    holders = SPELLINGS[:2] if few else SPELLINGS
    found = []
    for held in holders:
        port = free_port()
        with another(held.format(port)) as process:
            found += [named(other.format(port), f"a run of smoke, process {process}") for other in SPELLINGS]
    yield _row(f"{len(SPELLINGS)} spellings of one address", found)

    found = []
    for change in ENVIRONMENTS:
        port = free_port()
        with another(f"tcp://127.0.0.1:{port}", change=change) as process:
            found.append(named(f"tcp://127.0.0.1:{port}", f"process {process}"))
    yield _row("with another XDG_RUNTIME_DIR or TMPDIR, and without", found)

    yield _row("a serial port by its device and by two links", serial_links())
    if os.getuid() == 0:
        port = free_port()
        with another(f"tcp://127.0.0.1:{port}", user=NOBODY) as process:
            found = [named(f"tcp://localhost:{port}", f"process {process} of user nobody")]
        yield _row("another user", found)
    yield _row("let go by a kill", [after_a_kill() for _ in range(3 if few else 20)], "free")


def _row(line: str, found: list[bool], what: str = "refused, the holder named") -> Row:
    return Row(line, len(found), f"{sum(found)} {what}", all(found))


@contextmanager
def another(text: str, *, user: int | None = None, change: Mapping[str, str] | None = None) -> Iterator[int]:
    """Another process, of which the number is given, holds an address meanwhile."""
    words = [sys.executable, "-c", HOLDS, text, str(os.getuid() if user is None else user)]
    environment = {name: value for name, value in os.environ.items() if name not in ("XDG_RUNTIME_DIR", "TMPDIR")}
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=environment | dict(change or {})
    ) as process:
        try:
            if process.stdout is None or process.stdout.readline() != b"held\n":
                raise AssertionError("the other process does not hold it")
            yield process.pid
        finally:
            process.kill()


def named(text: str, who: str) -> bool:
    """Return whether an address is refused, with the words that name who has it."""
    try:
        with address_lock([Address.parse(text)], "a trial"):
            return False
    except InUseError as problem:
        return who in str(problem)


def serial_links() -> list[bool]:
    """A pseudo-terminal held by one of its names, and asked for by all."""
    near, far = pty.openpty()
    device = os.ttyname(far)
    try:
        with tempfile.TemporaryDirectory() as folder:
            names = [device, f"{folder}/by-id", f"{folder}/by-path"]
            for name in names[1:]:
                Path(name).symlink_to(device)
            found = []
            for held in names:
                with another(f"serial://{held}?baud=9600") as process:
                    found += [named(f"slcan://{other}", f"process {process}") for other in names]
            return found
    finally:
        os.close(near)
        os.close(far)


def after_a_kill() -> bool:
    """Return whether an address is free again once its holder was killed."""
    text = f"tcp://127.0.0.1:{free_port()}"
    with another(text):
        pass
    with address_lock([Address.parse(text)], "a trial"):
        return True
