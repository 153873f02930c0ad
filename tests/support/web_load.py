"""Hostile clients of a station, and the delay of its aborts meanwhile."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

from bench.runner.control import control_socket
from bench.store.runs import RunDirectory

_pause = threading.Event().wait


class Run:
    """A run of this process, for its control socket; `heard` are the instants of its aborts."""

    def __init__(self, runs: Path) -> None:
        self.directory = RunDirectory.create(runs, datetime(2026, 11, 21, tzinfo=UTC), "smoke", "a")
        self.directory.write_json("manifest.json", {"state": "running", "units": [], "request": {}})
        self.name = self.directory.path.name
        self.heard: list[float] = []

    async def _abort(self, _: Mapping[str, str]) -> str:
        self.heard.append(perf_counter())
        return "aborted"

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """Answer commands until the block ends."""
        loop = asyncio.new_event_loop()
        ready, ended = threading.Event(), asyncio.Event()

        async def work() -> None:
            with control_socket(self.directory.path, {"abort": self._abort}):
                ready.set()
                await ended.wait()

        thread = threading.Thread(target=loop.run_until_complete, args=(work(),))
        thread.start()
        ready.wait()
        try:
            yield
        finally:
            loop.call_soon_threadsafe(ended.set)
            thread.join()
            loop.close()
            self.directory.release()


class Client(socket.socket):
    """Connection that sends something and reads nothing."""

    def __init__(self, address: tuple[str, int], sends: bytes) -> None:
        super().__init__(socket.AF_INET)
        self.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.settimeout(5.0)
        try:
            self.connect(address)
            self.sendall(sends)
        except OSError:
            self.close()
            raise
        self.setblocking(False)

    @property
    def is_closed(self) -> bool:
        """True if the station has closed it."""
        try:
            return self.recv(1, socket.MSG_PEEK) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True


@contextmanager
def half_open(address: tuple[str, int], number: int) -> Iterator[list[int]]:
    """Keep a number of connections half-open, a new one for each that the station closes; yield how many it closed."""
    closed, over, clients = [0], threading.Event(), list[Client]()

    def flood() -> None:
        while not over.wait(0.5):
            for client in [each for each in clients if each.is_closed]:
                client.close()
                clients.remove(client)
                closed[0] += 1
            with suppress(OSError):
                while len(clients) < number and not over.is_set():
                    clients.append(Client(address, b"POST /api/v1/runs/x/abort HTTP/1.1\r\nHost: local"))

    thread = threading.Thread(target=flood)
    thread.start()
    try:
        _pause(1.0)
        yield closed
    finally:
        over.set()
        thread.join()
        for client in clients:
            client.close()


def reader(address: tuple[str, int], path: str, token: str) -> Client:
    """Return a reader of a stream of events who reads nothing."""
    return Client(address, f"GET {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n".encode())


def abort(address: tuple[str, int], run: Run, token: str) -> tuple[float, float]:
    """Send an abort; return the times in s until the run and the sender had it."""
    begun, heard = perf_counter(), len(run.heard)
    with socket.create_connection(address, timeout=10.0) as client:
        head = f"POST /api/v1/runs/{run.name}/abort HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n"
        client.sendall(f"{head}Authorization: Bearer {token}\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: client.recv(65536), b""))
    assert b" 200 OK" in answer, answer
    assert json.loads(answer.rpartition(b"\r\n\r\n")[2]) == {"answer": "aborted"}
    return run.heard[heard] - begun, perf_counter() - begun


def memory_bytes(process: int) -> int:
    """Return the resident memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096
