"""A station as a process of its own, and requests to it."""

from __future__ import annotations

import json
import os
import signal
import ssl
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from bench.clock import Stopwatch

_pause = threading.Event().wait


@dataclass
class Served:
    """A running station: its process, URL, the code for the first login, and a client with the token of its user."""

    process: subprocess.Popen[str]
    url: str
    code: str
    folder: Path
    client: httpx.Client

    def get(self, path: str, **query: Any) -> Any:
        """Return the content of an answer of the API."""
        answer = self.client.get(f"/api/v1/{path}", params=query)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def post(self, path: str, content: Any = None, **headers: str) -> Any:
        """Send something to the API, and return the content of its answer."""
        answer = self.client.post(f"/api/v1/{path}", json=content or {}, headers=headers)
        assert answer.status_code < 300, answer.text
        return answer.json() if answer.content else None

    def submit(self, sequence: str = "smoke", *, bench: str = "demo", **more: Any) -> Any:
        """Submit an item, and return it."""
        return self.post("queue", {"sequence": sequence, "bench": bench, "speed": "max", **more})

    def until(self, holds: Callable[[], Any], within_s: float = 60.0) -> Any:
        """Wait until a condition holds, and return its value."""
        watch = Stopwatch()
        while not (found := holds()):
            assert watch.elapsed_s() < within_s, self.get("queue", all_=True)
            _pause(0.1)
        return found

    def ended(self, item: Any, within_s: float = 60.0) -> Any:
        """Wait until an item has ended or was refused, and return it."""

        def over() -> Any:
            found = self.get(f"queue/{item['id']}")
            return found if found["state"] in ("ended", "refused", "cancelled") else None

        return self.until(over, within_s)


@contextmanager
def serving(
    folder: Path,
    *options: str,
    env: Mapping[str, str] | None = None,
    has_users: bool = False,
    verify: ssl.SSLContext | bool = True,
) -> Iterator[Served]:
    """`bench serve` in a folder until the block ends; the station's own records are in `folder/station`.

    A station that has users prints no code. `verify` are the certificates that its client trusts.
    """
    words = ["serve", *options, "--folder", str(folder / "station"), "--port", "0", "--runs", str(folder / "runs")]
    with server(words, folder, folder / "station", env=env, has_users=has_users, verify=verify) as found:
        process, url, code, client = found
        yield Served(process, url, code, folder, client)


@contextmanager
def server(
    words: list[str],
    folder: Path,
    own: Path,
    *,
    env: Mapping[str, str] | None = None,
    has_users: bool = False,
    verify: ssl.SSLContext | bool = True,
) -> Iterator[tuple[subprocess.Popen[str], str, str, httpx.Client]]:
    """`bench` as a server until the block ends, with records of its own: process, URL, code, and a client with a token.

    One that has users prints no code. `verify` are the certificates that the client trusts.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "bench", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
        env={**os.environ, **(env or {})},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        first = process.stdout.readline()
        assert first, process.stderr.read()
        second = process.stdout.readline() if "//127.0.0.1" in first and not has_users else ""
        url = json.loads((own / "station.json").read_text())["url"]
        headers = {"authorization": f"Bearer {(own / 'token').read_text()}"}
        with httpx.Client(base_url=url, headers=headers, timeout=30, verify=verify) as client:
            yield process, url, second.rpartition(" ")[2].strip(), client
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=20)
