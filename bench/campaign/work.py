"""The side of a worker: one task at a time, in a process without rights to a bench."""

from __future__ import annotations

import os
import socket
import threading
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.campaign.isolation import isolate
from bench.campaign.program import ROOT, digest_of, identity
from bench.campaign.tasks import Result, canonical
from bench.clock import Stopwatch, wall_utc
from bench.errors import BenchError
from drivers.errors import DriverError
from drivers.installed import loaded

_ONE_AT_A_TIME = threading.Lock()  # runs replace parts of the process, such as signal handlers and time


class OtherProgram(Exception):
    """Refusal of a task by a worker with another program than that of the campaign: its host and identity."""

    def __init__(self, host: str, found: Mapping[str, str]) -> None:
        super().__init__(host, found)
        self.host, self.found = host, found


def do(key: str, task: str, does: str, arguments: Mapping[str, Any], program: str) -> Result:
    """Do a task; whatever it raises is the problem of its result.

    Raises OtherProgram if the program of this process has another digest.
    """
    if digest_of(identity()) != program:
        raise OtherProgram(socket.gethostname(), dict(identity()))
    with _ONE_AT_A_TIME:
        isolate()
        watch, content, problem = Stopwatch(), None, ""
        try:
            content = loaded(does)(**arguments)
            canonical(content)
        except Exception as raised:  # noqa: BLE001  a campaign has results of its other tasks
            content, problem = None, problem_of(raised)
        took_s = round(watch.elapsed_s(), 4)
    at = wall_utc().isoformat(timespec="seconds")
    return Result(key, task, program, content, problem, took_s, at, worker_name())


def worker_name() -> str:
    """Name of this process in results."""
    return f"{socket.gethostname()}:{os.getpid()}"


def problem_of(raised: Exception) -> str:
    """Message of an error, with its type and place if it is not one of the bench."""
    if isinstance(raised, BenchError | DriverError):
        return " ".join(str(raised).split())
    own = [frame for frame in traceback.extract_tb(raised.__traceback__) if frame.filename.startswith(str(ROOT))]
    where = f" ({Path(own[-1].filename).name}:{own[-1].lineno})" if own else ""
    return f"{type(raised).__name__}: {' '.join(str(raised).split())[:1000]}{where}"
