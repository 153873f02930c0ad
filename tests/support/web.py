"""A station without a server: its application is called in this process, with a run that notes its commands."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

from argon2 import PasswordHasher

from bench.runner.control import STOPS, control_socket
from bench.station.daemon import Daemon
from bench.station.settings import read_station
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.station.worker import Workers
from bench.store.runs import RunDirectory
from bench.web.access import EVERYTHING, ROLES, Person
from bench.web.app import make_app
from bench.web.cookies import COOKIE
from bench.web.guards import Guards
from bench.web.identity import Identity
from bench.web.limits import Limits
from bench.web.patience import Patience
from bench.web.services import Services
from tests.support import worker_processes  # noqa: F401  its tracker is to be there before

PASSWORD = "correct horse battery"
STARTED = datetime(2026, 11, 21, 20, 0, tzinfo=UTC)
COMMANDS = (*STOPS, "pause", "resume", "skip", "repeat", "answer", "order", "halt", "finish", "alive")
SESSION = {"silence_s": 300.0, "left_s": 300.0, "busy": {}}  # of manual control
TERMINAL = Person("anna", EVERYTHING, "token", is_user=False)


class Answer(NamedTuple):
    """Answer of the application."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def json(self) -> Any:
        """Return the content."""
        return json.loads(self.body)


class Here:
    """A station in this process. `heard` are the commands that its run was sent, `token` may do everything."""

    def __init__(self, folder: Path, *, secure: bool = False, idle: Any = None) -> None:
        settings = read_station(None, folder / "station", runs=folder / "runs")
        self.database, self.workers = Database(settings.folder), Workers()
        self.daemon = Daemon(settings, self.database, self.workers, lambda _: None)
        self.now_s = itertools.count(0.0, 1.0)  # a second for each look, so that no rate is exceeded
        patience = Patience(lambda: next(self.now_s))
        self.identity = Identity(self.database, idle, patience)
        self.identity._hasher = PasswordHasher(time_cost=1, memory_cost=64, parallelism=1)  # checks take no time here
        self.audit = Audit(self.database)
        self.services = Services(self.daemon, self.identity, self.audit)
        app = make_app(self.services, ["bench.lab"], secure=secure)._app  # behind what observes requests
        assert isinstance(app, Guards)
        app._limits = Limits(lambda: next(self.now_s))
        self.app, self.secure = app, secure
        self.token = self.identity.new_token(TERMINAL, "all", EVERYTHING, 1)
        self.run = RunDirectory.create(settings.runs, STARTED, "smoke", "a")
        request = {"bench": str(settings.benches["demo"])}
        self.run.write_json("manifest.json", {"state": "running", "units": [], "request": request})
        self.heard: list[tuple[str, str]] = []

    def add_users(self) -> None:
        """Add a user of each role, with its name."""
        for role in ROLES:
            self.identity.set_user(role, role, PASSWORD)

    def session(self, name: str) -> str:
        """Return the secret of a new session of a user."""
        role = self.identity.role(name)
        return self.identity._begin(name, ROLES[str(role)]).secret

    def close(self) -> None:
        """End it."""
        self.daemon.commands.shutdown()
        self.run.release()
        self.daemon.drafts.close()
        self.workers.close()
        self.daemon.approvals.close()
        self.database.close()

    async def ask(
        self, method: str, path: str, *, token: str = "", cookie: str = "", content: Any = None, body: bytes = b"",
        headers: Mapping[str, str] | None = None, address: str = "127.0.0.1",
    ) -> Answer:  # fmt: skip
        """Send a request; with a cookie, as a page of the station does."""
        scheme = "https" if self.secure else "http"
        given = {"host": "localhost:8421"}
        given |= {"authorization": f"Bearer {token}"} if token else {}
        if cookie:
            name = f"__Host-{COOKIE}" if self.secure else COOKIE
            given |= {"cookie": f"{name}={cookie}", "origin": f"{scheme}://localhost:8421"}
        given |= {name.lower(): value for name, value in (headers or {}).items()}
        if content is not None:
            body, given["content-type"] = json.dumps(content).encode(), "application/json"
        given["content-length"] = str(len(body))
        raw = [(name.encode(), value.encode("latin-1")) for name, value in given.items() if value is not None]
        return await called(self.app, method, path, raw, [body], address, scheme)


async def called(
    app: Any, method: str, target: str, headers: list[tuple[bytes, bytes]], body: list[bytes],
    address: str = "127.0.0.1", scheme: str = "http",
) -> Answer:  # fmt: skip
    """Call an ASGI application as uvicorn does; the client goes away after the first part of a stream."""
    path, _, query = target.partition("?")
    scope = {
        "type": "http", "asgi": {"version": "3.0", "spec_version": "2.3"}, "http_version": "1.1", "method": method,
        "scheme": scheme, "path": unquote(path), "raw_path": path.encode(), "query_string": query.encode(),
        "root_path": "", "headers": headers, "server": ("127.0.0.1", 8421), "client": (address, 50000), "state": {},
    }  # fmt: skip
    parts = [
        {"type": "http.request", "body": part, "more_body": number < len(body)} for number, part in enumerate(body, 1)
    ]
    seen, sent = asyncio.Event(), list[Any]()

    async def receive() -> Any:
        if parts:
            return parts.pop(0)
        await seen.wait()
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        sent.append(message)
        if message.get("body") or (message["type"] == "http.response.start" and _is_stream(message)):
            seen.set()

    await app(scope, receive, send)
    start = sent[0]
    return Answer(
        start["status"], {name.decode().lower(): value.decode("latin-1") for name, value in start["headers"]},
        b"".join(message.get("body", b"") for message in sent[1:]),
    )  # fmt: skip


def _is_stream(start: Any) -> bool:
    return any(value.startswith(b"text/event-stream") for name, value in start["headers"] if name == b"content-type")


@asynccontextmanager
async def station_here(folder: Path, **more: Any) -> AsyncIterator[Here]:
    """Yield a station with a run that notes its commands."""
    here = Here(folder, **more)

    def handler(command: str) -> Callable[[Mapping[str, str]], Awaitable[str]]:
        async def handle(arguments: Mapping[str, str]) -> str:
            here.heard.append((command, arguments["by"]))
            return json.dumps(SESSION) if command == "alive" else "done"

        return handle

    try:
        with control_socket(here.run.path, {name: handler(name) for name in COMMANDS}):
            yield here
    finally:
        here.close()


def with_station(folder: Path, act: Callable[[Here], Awaitable[None]], **more: Any) -> None:
    """Call `act` with a station."""

    async def main() -> None:
        async with station_here(folder, **more) as here:
            await act(here)

    asyncio.run(main())


def with_signers(folder: Path, act: Callable[[Here], Awaitable[None]]) -> None:
    """Call `act` with a station that has users, one of whom has operated the shared smoke run; reports are HTML."""

    async def use(here: Here) -> None:
        here.add_users()
        here.identity.set_user("A. Technician", "engineer", PASSWORD)
        here.services = here.app._app.state.services = here.services._replace(report_form="html")
        await act(here)

    with_station(folder, use)
