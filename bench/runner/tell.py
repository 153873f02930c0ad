"""Commands to a running run from another process."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from bench.clock import Stopwatch
from bench.errors import InputError, StoreError
from bench.runner.control import ALL, ANSWER_S, STOPPING, STOPS, socket_address
from bench.runner.held import peer
from bench.store.kept_json import TEXT, object_of, read_kept
from bench.store.runs import LOCK, RUNNER, RunSummary, summary

ANSWER_LIMIT_BYTES = 2**20
_NAMES = object_of({ALL: TEXT, STOPPING: TEXT}, (ALL, STOPPING))
_BETWEEN_ATTEMPTS_S = 0.05
_SIGNALS = {"abort": signal.SIGTERM, "stop": signal.SIGINT}
_pause = threading.Event().wait


def send_command(run: Path, command: str, **arguments: str) -> str:
    """Send a command to a running run; return its answer. Raises InputError without an answer.

    It is sent again while the run has too many clients. A run that has no socket yet, or no more, is ended by a signal.
    """
    found, watch = summary(run), Stopwatch()
    if command in _SIGNALS and found.state == "running" and not (run / RUNNER).exists() and _signalled(found, command):
        return "the run is opening or closing its devices; it was sent a signal, and ends"
    try:
        runner = run / RUNNER
        names, owner = read_kept(runner, _NAMES), runner.stat().st_uid
        address = socket_address(names[STOPPING if command in STOPS else ALL])
        answer = _asked(address, owner, {"command": command, **arguments})
        while "again" in answer and watch.elapsed_s() < ANSWER_S:
            _pause(_BETWEEN_ATTEMPTS_S)
            answer = _asked(address, owner, {"command": command, **arguments})
    except (OSError, ValueError, RecursionError, StoreError) as problem:
        if found.state != "running":
            raise InputError(f"{found.id}: this run is not running; its state is {found.state}") from None
        raise InputError(f"{found.id}: the run does not answer ({problem}); Ctrl-C where it runs stops it") from None
    if "refused" in answer:
        raise InputError(f"{found.id}: {answer['refused']}")
    return str(answer["done"])


def _signalled(run: RunSummary, command: str) -> bool:
    """Send the signal of a command to the process of a run; False if its process is not known."""
    process = run.manifest.get("process")
    if not isinstance(process, int) or process <= 1:
        return False
    try:
        held = {os.readlink(each) for each in Path(f"/proc/{process}/fd").iterdir()}
        if str((run.path / LOCK).resolve()) not in held:  # another process has got its number
            return False
        os.kill(process, _SIGNALS[command])
    except OSError:
        return False
    return True


def _asked(address: str, owner: int, request: dict[str, str]) -> dict[str, Any]:
    """Return the answer of the listener, if it is a process of the owner of the run."""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(2 * ANSWER_S)
        try:
            client.connect(address)
        except BlockingIOError:  # its backlog is full
            return {"refused": "too many clients are waiting for this run", "again": True}
        if peer(client)[1] != owner:
            raise ConnectionRefusedError("the socket belongs to a program of another user")
        with suppress(BrokenPipeError):  # refused before the request: the reason is in the answer
            client.sendall(json.dumps(request).encode() + b"\n")
        answer = json.loads(client.makefile("rb").readline(ANSWER_LIMIT_BYTES))
        if not isinstance(answer, dict) or not answer.keys() & {"done", "refused"}:
            raise ValueError("its answer is not valid")
        return answer
