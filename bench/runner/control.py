"""The control sockets of a run: what another process of the same user commands, and asks.

One line of JSON in, one out. There are two sockets, named in the run's `runner.json`: one for what ends the run, and
one for everything, so that whoever floods the second does not stand before whoever stops. Both are served by one thread
with an event loop of its own, in real time whatever time the run keeps; a command itself is done in the run's loop.

The sockets have abstract names, which are in no folder and go with the process.
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
from bench.files import write_whole
from bench.runner.held import peer
from bench.store.runs import RUNNER, json_text

ALL, STOPPING = "socket", "stop"  # the keys of the two in `runner.json`
STOPS = frozenset({"stop", "stop_after_step", "abort"})
REQUEST_S = 2.0  # for the whole line, however it comes
ANSWER_S = 10.0
CONNECTIONS = 128  # on each socket at a time
BACKLOG = 256
LAST_ANSWERS_S = 0.2  # for what was done just before the end
LINE_LIMIT_BYTES = 4096
BUSY: Mapping[str, Any] = {"refused": "too many clients are connected to this run", "again": True}

Arguments = Mapping[str, str]
Handlers = Mapping[str, Callable[[Arguments], Awaitable[str]]]


@contextmanager
def control_socket(folder: Path, handlers: Handlers) -> Iterator[None]:
    """Serves `handlers` while inside; each does what its name says, in the running loop, and returns what to answer.

    A handler is given what was said besides its name, with the name of whose program it was in `user`, and in `by` as
    well if nobody else was named there. It refuses by raising InputError. Raises StoreError when the sockets or
    `runner.json` cannot be made.
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
        write_whole(folder / RUNNER, json_text({"pid": os.getpid(), **names}).encode())
        yield


def _remove(path: Path) -> None:
    with suppress(OSError):  # how the run ended is not to be lost for it
        path.unlink(missing_ok=True)


def socket_address(name: str) -> str:
    """The address of a socket by its name in `runner.json`, where an abstract one begins with @."""
    return f"\0{name[1:]}" if name.startswith("@") else name


async def _serve(channels: list[tuple[socket.socket, _Channel]], ended: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    servers = [
        await loop.create_unix_server(channel.asker, sock=listener, backlog=BACKLOG) for listener, channel in channels
    ]
    await ended.wait()
    for server in servers:
        server.close()
    await asyncio.gather(*(channel.close() for _, channel in channels))


class _Channel:
    """Whoever asks on one socket, and what he may ask; at most `at_once` are answered by the run's loop at a time."""

    def __init__(self, run: asyncio.AbstractEventLoop, handlers: Handlers, *, at_once: int) -> None:
        self._run, self._handlers = run, handlers
        self._turn = asyncio.Semaphore(at_once)
        self.askers: dict[_Asker, None] = {}  # the oldest first
        self.tasks: set[asyncio.Task[None]] = set()

    def asker(self) -> _Asker:
        """One more who asks."""
        return _Asker(self)

    def admit(self, asker: _Asker) -> bool:
        """Takes one more in; where it is full, the oldest who has not yet asked gives way, and else it is false."""
        if len(self.askers) >= CONNECTIONS:
            idle = next((each for each in self.askers if not each.has_asked), None)
            if idle is None:
                return False
            idle.end(BUSY)
        self.askers[asker] = None
        return True

    async def close(self) -> None:
        """Sends the last answers; who has none by then is told that the run ends."""
        if self.tasks:
            await asyncio.wait(self.tasks, timeout=LAST_ANSWERS_S)
        for asker in list(self.askers):
            asker.end({"refused": "the run is about to end"})
        for task in self.tasks:
            task.cancel()
        await asyncio.sleep(0)  # connections close in the next turn

    async def answer(self, line: bytes, user: int) -> Mapping[str, Any]:
        """The answer to one line."""
        try:
            said = json.loads(line)
            handler = self._handlers[said.pop("command")]
            arguments = {str(key): str(value) for key, value in said.items()}
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
        """What the run answers; a command that it has not come to yet stays commanded."""

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
        except Exception as problem:  # noqa: BLE001  whoever asked is told, and does not wait for nothing
            return {"refused": f"an internal error of this program: {problem!r}"}


class _Asker(asyncio.Protocol):
    """One connection: a line, its answer, and the end, all in bounded time."""

    def __init__(self, channel: _Channel) -> None:
        self._channel = channel
        self._heard = b""
        self._user = -1
        self._transport: asyncio.Transport | None = None
        self._limit: asyncio.TimerHandle | None = None
        self.has_asked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Somebody is there: he is refused, or has some time for his line."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  that of a stream server
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
        """A part of the line; with its end it is answered."""
        if self.has_asked or self._transport is None or self._transport.is_closing():
            return
        self._heard += data
        line, end, _ = self._heard.partition(b"\n")
        if end or len(self._heard) > LINE_LIMIT_BYTES:
            self._ask(line if len(line) <= LINE_LIMIT_BYTES else b"")

    def eof_received(self) -> bool:
        """Nothing more will be said: what was is the line."""
        if not self.has_asked:
            self._ask(self._heard)
        return True  # the answer is still to be sent

    def connection_lost(self, exc: Exception | None) -> None:
        """He has gone."""
        self._stop_limit()
        self._channel.askers.pop(self, None)

    def end(self, answer: Mapping[str, Any]) -> None:
        """Answers and closes; who does not take the answer in time is left."""
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
