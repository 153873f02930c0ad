"""Control sockets of a run: commands and queries from other processes of the same user.

Each request and each answer is one line of JSON. There are two sockets, named in the run's `runner.json`: one only for
ending the run and one for everything, so that a flood on the second cannot block the first. Both are served by one
thread with its own event loop in real time, whatever time the run keeps; the command itself runs in the run's loop.

The sockets have abstract names, which are in no folder and disappear with the process.
"""

from __future__ import annotations

import asyncio
import json
import os
import pwd
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from bench.errors import InputError, StoreError
from bench.files import write_atomically
from bench.runner.held import peer
from bench.store.runs import RUNNER, json_text

ALL, STOPPING = "socket", "stop"  # keys in `runner.json`
STOPS = frozenset({"stop", "stop_after_step", "abort"})
REQUEST_S = 2.0  # for the whole line
ANSWER_S = 10.0
CONNECTIONS = 128  # limit of each socket
BACKLOG = 256
LAST_ANSWERS_S = 0.2  # for commands executed just before the end
LINE_LIMIT_BYTES = 4096
BUSY: Mapping[str, Any] = {"refused": "too many clients are connected to this run", "again": True}

Arguments = Mapping[str, str]
Handler = Callable[[Arguments], Awaitable[str]]
Handlers = Mapping[str, Handler]


@contextmanager
def control_socket(folder: Path, handlers: Handlers) -> Iterator[None]:
    """Serve `handlers` in the block; each runs in the running loop and returns its answer.

    A handler receives the arguments of the request, the name of the sender's user in `user`, and in `by` as well unless
    the request has one. It refuses by raising InputError. Raises StoreError if the sockets or `runner.json` cannot be
    created.
    """
    own, run = asyncio.SelectorEventLoop(), asyncio.get_running_loop()
    stopping = {name: handler for name, handler in handlers.items() if name in STOPS}
    ended = asyncio.Event()
    with ExitStack() as undo:
        undo.callback(own.close)
        try:
            listeners = {key: undo.enter_context(socket.socket(socket.AF_UNIX)) for key in (ALL, STOPPING)}
            names = {key: f"@inertial-test-bench/{os.getpid()}/{key}-{secrets.token_hex(8)}" for key in listeners}
            for key, listener in listeners.items():
                listener.bind(socket_address(names[key]))
                listener.listen(BACKLOG)
        except OSError as problem:
            raise StoreError(f"the control socket cannot be created ({problem})") from problem
        channels = [
            (listeners[STOPPING], _Channel(run, stopping, at_once=CONNECTIONS)),
            (listeners[ALL], _Channel(run, handlers, at_once=1)),
        ]
        serving = _serve(channels, ended)
        thread = threading.Thread(target=own.run_until_complete, args=(serving,), name="control", daemon=True)
        thread.start()
        undo.callback(thread.join)
        undo.callback(own.call_soon_threadsafe, ended.set)
        undo.callback(_remove, folder / RUNNER)
        write_atomically(folder / RUNNER, json_text({"pid": os.getpid(), **names}).encode())
        yield


def _remove(path: Path) -> None:
    with suppress(OSError):  # must not hide the outcome of the run
        path.unlink(missing_ok=True)


def socket_address(name: str) -> str:
    """Return the address of a socket from its name in `runner.json`, where @ marks an abstract one."""
    return f"\0{name[1:]}" if name.startswith("@") else name


async def _serve(channels: list[tuple[socket.socket, _Channel]], ended: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    servers = [
        await loop.create_unix_server(channel.client, sock=listener, backlog=BACKLOG) for listener, channel in channels
    ]
    await ended.wait()
    for server in servers:
        server.close()
    await asyncio.gather(*(channel.close() for _, channel in channels))


class _Channel:
    """Clients of one socket and its handlers; the run's loop handles at most `at_once` requests at a time."""

    def __init__(self, run: asyncio.AbstractEventLoop, handlers: Handlers, *, at_once: int) -> None:
        self._run, self._handlers = run, handlers
        self._turn = asyncio.Semaphore(at_once)
        self.clients: dict[_Client, None] = {}  # oldest first
        self.tasks: set[asyncio.Task[None]] = set()

    def client(self) -> _Client:
        """Return the protocol of a new client."""
        return _Client(self)

    def admit(self, client: _Client) -> bool:
        """Admit a client; if full, drop the oldest one without a request, otherwise return False."""
        if len(self.clients) >= CONNECTIONS:
            idle = next((each for each in self.clients if not each.has_asked), None)
            if idle is None:
                return False
            idle.end(BUSY)
        self.clients[client] = None
        return True

    async def close(self) -> None:
        """Send the last answers; clients without one are told that the run ends."""
        if self.tasks:
            await asyncio.wait(self.tasks, timeout=LAST_ANSWERS_S)
        for client in list(self.clients):
            client.end({"refused": "the run is about to end"})
        for task in self.tasks:
            task.cancel()
        await asyncio.sleep(0)  # connections close in the next turn

    async def answer(self, line: bytes, user: int) -> Mapping[str, Any]:
        """Return the answer to one line."""
        try:
            content = json.loads(line)
            handler = self._handlers[content.pop("command")]
            arguments = {str(key): str(value) for key, value in content.items()}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return {"refused": f"expected one of {', '.join(self._handlers)}"}
        arguments["user"] = _user(user)
        arguments["by"] = arguments.get("by") or arguments["user"]
        if not arguments["by"].isprintable():
            return {"refused": "the name of the sender contains unprintable characters"}
        try:
            await asyncio.wait_for(self._turn.acquire(), ANSWER_S)
        except TimeoutError:
            return BUSY
        try:
            return await self._done(handler, arguments)
        finally:
            self._turn.release()

    async def _done(self, handler: Callable[[Arguments], Awaitable[str]], arguments: Arguments) -> Mapping[str, Any]:
        """Return the answer of the run; a command that it has not handled yet stays pending."""

        async def act() -> str:
            return await handler(arguments)

        acting = act()
        try:
            answer = asyncio.wrap_future(asyncio.run_coroutine_threadsafe(acting, self._run))
        except RuntimeError:  # its loop is closed
            acting.close()
            return {"refused": "the run is about to end"}
        done, _ = await asyncio.wait({answer}, timeout=ANSWER_S)
        if not done:
            return {"refused": f"the run has not acted on it within {ANSWER_S:g} s; it will as soon as it can"}
        try:
            return {"done": answer.result()}
        except InputError as problem:
            return {"refused": str(problem)}
        except asyncio.CancelledError:
            return {"refused": "the run is about to end"}
        except Exception as problem:  # noqa: BLE001  the client gets an answer and does not wait in vain
            return {"refused": f"an internal error of this program: {problem!r}"}


class _Client(asyncio.Protocol):
    """One connection: a line, its answer and the end, all in bounded time."""

    def __init__(self, channel: _Channel) -> None:
        self._channel = channel
        self._heard = b""
        self._user = -1
        self._transport: asyncio.Transport | None = None
        self._limit: asyncio.TimerHandle | None = None
        self.has_asked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Refuse the client, or start the time limit of its request."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  always true for a stream server
        self._transport = transport
        _, self._user = peer(transport.get_extra_info("socket"))
        if self._user not in (0, os.getuid()):
            self.end({"refused": "this run belongs to another user"})
        elif not self._channel.admit(self):
            self.end(BUSY)
        else:
            late = {"refused": f"no complete line within {REQUEST_S:g} s"}
            self._limit = asyncio.get_running_loop().call_later(REQUEST_S, self.end, late)

    def data_received(self, data: bytes) -> None:
        """Collect a part of the line; answer when it is complete."""
        if self.has_asked or self._transport is None or self._transport.is_closing():
            return
        self._heard += data
        line, end, _ = self._heard.partition(b"\n")
        if end or len(self._heard) > LINE_LIMIT_BYTES:
            self._ask(line if len(line) <= LINE_LIMIT_BYTES else b"")

    def eof_received(self) -> bool:
        """Treat the data received as the line, since no more will come."""
        if not self.has_asked:
            self._ask(self._heard)
        return True  # keep the connection open for the answer

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the client."""
        self._stop_limit()
        self._channel.clients.pop(self, None)

    def end(self, answer: Mapping[str, Any]) -> None:
        """Answer and close; a client that does not take the answer in time is dropped."""
        self._stop_limit()
        if self._transport is None or self._transport.is_closing():
            return
        self._transport.write(json.dumps(answer, ensure_ascii=False).encode() + b"\n")
        self._transport.close()
        if self._transport.get_write_buffer_size():
            self._limit = asyncio.get_running_loop().call_later(REQUEST_S, self._transport.abort)

    def _ask(self, line: bytes) -> None:
        self.has_asked = True
        self._stop_limit()
        task = asyncio.get_running_loop().create_task(self._answer(line))
        self._channel.tasks.add(task)
        task.add_done_callback(self._channel.tasks.discard)

    async def _answer(self, line: bytes) -> None:
        self.end(await self._channel.answer(line, self._user))

    def _stop_limit(self) -> None:
        if self._limit is not None:
            self._limit.cancel()
            self._limit = None


def _user(number: int) -> str:
    with suppress(KeyError):
        return pwd.getpwuid(number).pw_name
    return f"user {number}"
