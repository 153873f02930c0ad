"""Workers of a cluster of one computer: processes, each of which is started again when it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from bench.clock import Stopwatch

MODULE = "bench.campaign.local_worker"
SHORT_LIFE_S, PAUSE_S = 3.0, 2.0  # a worker that ends as soon as this is not started again at once


class Workers:
    """So many worker processes; `given` is what each gets as JSON, beside its name."""

    def __init__(self, count: int, given: Mapping[str, Any]) -> None:
        self._given = given
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._processes: set[subprocess.Popen[str]] = set()
        self._threads = [threading.Thread(target=self._keep, args=(number,)) for number in range(count)]

    @contextmanager
    def running(self) -> Iterator[None]:
        """Keep them running during the block; afterwards none is left."""
        for thread in self._threads:
            thread.start()
        try:
            yield
        finally:
            self._ending.set()
            with self._lock:
                for process in self._processes:
                    _kill(process)
            for thread in self._threads:
                thread.join()

    def _keep(self, number: int) -> None:
        """Start a worker, and another one whenever it has ended."""
        while not self._ending.is_set():
            watch = Stopwatch()
            with self._lock:
                if self._ending.is_set():
                    return
                process = self._started(number)
                self._processes.add(process)
            with process:  # waits for its end, and closes its input
                process.wait()
            _kill(process)  # what it has started itself
            with self._lock:
                self._processes.discard(process)
            if watch.elapsed_s() < SHORT_LIFE_S:
                self._ending.wait(PAUSE_S)

    def _started(self, number: int) -> subprocess.Popen[str]:
        process = subprocess.Popen(  # noqa: S603  our own module
            [sys.executable, "-P", "-m", MODULE], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is for the campaign; and it has a group of its own
        )  # fmt: skip
        if process.stdin is not None:
            with suppress(BrokenPipeError):  # it has ended already
                process.stdin.write(json.dumps({**self._given, "name": f"{number}-{process.pid}"}) + "\n")
                process.stdin.flush()
        return process


def _kill(process: subprocess.Popen[str]) -> None:
    """Kill a worker with all processes that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
