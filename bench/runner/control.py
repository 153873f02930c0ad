"""The control socket of a run: what another process of the same user tells it, and asks of it.

A Unix socket in a folder of the user's own, named in the run's `runner.json`. One line of JSON in, one out. It lives in
a thread, so that it answers in real time whatever time the run keeps; what it is told is done in the run's own loop.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import json
import os
import socket
import socketserver
import struct
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from bench.errors import InputError, StoreError
from bench.store.runs import json_text, summary, write_whole

RUNNER = "runner.json"
ANSWER_S = 10.0
LINE_LIMIT_BYTES = 4096
ANSWER_LIMIT_BYTES = 2**20

Arguments = Mapping[str, str]
Handlers = Mapping[str, Callable[[Arguments], str]]


@contextmanager
def control_socket(folder: Path, handlers: Handlers) -> Iterator[None]:
    """Serves `handlers` while inside; each does what its name says, in the running loop, and returns what to answer.

    A handler is given what was said besides its name; it refuses by raising InputError. Raises StoreError when the
    socket or `runner.json` cannot be made.
    """
    try:
        address = own_folder() / f"{os.getpid()}-{folder.name[:40]}.sock"
        address.unlink(missing_ok=True)
        server = _Server(str(address), asyncio.get_running_loop(), handlers)
    except OSError as problem:
        raise StoreError(f"the control socket cannot be made ({problem})") from problem
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, name="control", daemon=True)
    thread.start()
    try:
        write_whole(folder / RUNNER, json_text({"pid": os.getpid(), "socket": str(address)}).encode())
        yield
    finally:
        server.shutdown()
        server.server_close()
        for path in (address, folder / RUNNER):
            path.unlink(missing_ok=True)


def tell(run: Path, command: str, **arguments: str) -> str:
    """Gives a command to a run that is under way; what it answers. Raises InputError when nobody does."""
    found = summary(run)
    try:
        address = json.loads((run / RUNNER).read_text(encoding="utf-8"))["socket"]
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(2 * ANSWER_S)
            client.connect(address)
            client.sendall(json.dumps({"command": command, **arguments}).encode() + b"\n")
            answer = json.loads(client.makefile("rb").readline(ANSWER_LIMIT_BYTES))
    except (OSError, ValueError, KeyError, TypeError) as problem:
        if found.state != "running":
            raise InputError(f"{found.id}: this run is not under way, it is {found.state}") from None
        raise InputError(f"{found.id}: the run does not answer ({problem}); Ctrl-C where it runs stops it") from None
    if "refused" in answer:
        raise InputError(f"{found.id}: {answer['refused']}")
    return str(answer["done"])


def own_folder() -> Path:
    """A folder that only this user can look into; Unix socket paths are limited to 107 bytes."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "inertial-test-bench" if base else Path(tempfile.gettempdir()) / f"itb-{os.getuid()}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = folder.lstat()
    if state.st_uid != os.getuid() or state.st_mode & 0o077:
        raise OSError(f"{folder} is open to others; remove it, or set XDG_RUNTIME_DIR to a folder of your own")
    return folder


class _Server(socketserver.ThreadingUnixStreamServer):
    daemon_threads = True

    def __init__(self, address: str, loop: asyncio.AbstractEventLoop, handlers: Handlers) -> None:
        super().__init__(address, _Request)
        self.loop, self.handlers = loop, handlers


class _Request(socketserver.StreamRequestHandler):
    """One question and its answer; whoever is slow only keeps himself waiting."""

    server: _Server
    timeout = ANSWER_S

    def handle(self) -> None:
        with contextlib.suppress(OSError):  # whoever asked may have gone
            self.wfile.write(json.dumps(self._answer(), ensure_ascii=False).encode() + b"\n")

    def _answer(self) -> dict[str, str]:
        credentials = self.request.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        if struct.unpack("3i", credentials)[1] not in (0, os.getuid()):
            return {"refused": "this run belongs to another user"}
        try:
            said = json.loads(self.rfile.readline(LINE_LIMIT_BYTES))
            handler = self.server.handlers[said.pop("command")]
            arguments = {str(key): str(value) for key, value in said.items()}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return {"refused": f"expected one of {', '.join(self.server.handlers)}"}
        try:
            return {"done": _in_loop(self.server.loop, lambda: handler(arguments)).result(ANSWER_S)}
        except InputError as problem:
            return {"refused": str(problem)}
        except (RuntimeError, TimeoutError):
            return {"refused": "the run is about to end"}


def _in_loop(loop: asyncio.AbstractEventLoop, handler: Callable[[], str]) -> concurrent.futures.Future[str]:
    """Calls `handler` in the loop; its result for this thread. Raises RuntimeError when the loop is closed."""
    future: concurrent.futures.Future[str] = concurrent.futures.Future()

    def call() -> None:
        try:
            future.set_result(handler())
        except InputError as problem:
            future.set_exception(problem)
        except Exception as problem:  # noqa: BLE001  whoever asked is told, and does not wait for nothing
            future.set_exception(InputError(f"a mistake of this program: {problem!r}"))

    loop.call_soon_threadsafe(call)
    return future
