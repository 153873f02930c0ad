"""`bench station` as a process of its own."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx

from bench.clock import Stopwatch
from tests.support.station import server

_pause = threading.Event().wait


class Board(NamedTuple):
    """The pages of all benches: their process, address, the code for the first login, and a client that may read."""

    process: subprocess.Popen[str]
    url: str
    code: str
    client: httpx.Client

    def page(self, path: str = "", **headers: str) -> str:
        """Return a page."""
        answer = self.client.get(f"/{path}", headers={"accept": "text/html", **headers})
        assert answer.status_code == 200, answer.text
        return answer.text

    def until(self, holds: Callable[[str], Any], within_s: float = 30.0) -> str:
        """Look at the page until a condition holds of it, and return it."""
        watch = Stopwatch()
        while not holds(page := self.page()):
            assert watch.elapsed_s() < within_s, page
            _pause(0.2)
        return page

    def memory_mb(self) -> float:
        """Return the memory of the process in MB."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("VmRSS")) / 1000


@contextmanager
def showing(folder: Path, broker: str, *options: str, env: Mapping[str, str] | None = None) -> Iterator[Board]:
    """`bench station` until the block ends; its own records are in `folder/overview`."""
    own = folder / "overview"
    words = ["station", "--broker", broker, "--port", "0", "--folder", str(own), "--zone", "Europe/Berlin", *options]
    with server(words, folder, own, env=env) as (process, url, code, client):
        yield Board(process, url, code, client)
