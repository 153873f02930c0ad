"""Server of a station: the daemon and its HTTP interface in one process and one event loop."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import uvicorn

from bench.errors import BenchError, InputError
from bench.files import write_atomically
from bench.runner.notify import notify
from bench.station.daemon import at_work
from bench.station.log import Log, libraries_in, make_log
from bench.station.settings import WHERE, Settings
from bench.web.access import EVERYTHING
from bench.web.app import make_app
from bench.web.audit import Audit
from bench.web.identity import Identity
from bench.web.services import Services

TOKEN = "token"  # noqa: S105  the name of its file
CONNECTIONS = 200
DAYS = 3650


class Listening(NamedTuple):
    """Address of a server, and its certificate and key; without these it speaks plain HTTP."""

    host: str = "127.0.0.1"
    port: int = 8421
    certificate: Path | None = None
    key: Path | None = None
    hosts: tuple[str, ...] = ()
    insecure: bool = False

    @property
    def is_loopback(self) -> bool:
        """True if only this computer can reach it."""
        return self.host in ("127.0.0.1", "::1", "localhost")


async def serve(settings: Settings, listening: Listening, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM; runs go on. `say` writes to the terminal, and to no log.

    Raises InputError for an address that is not allowed, InUseError if another station has the folder, StoreError.
    """
    log = make_log(sys.stderr)
    with libraries_in(log):
        await _serve(settings, listening, say, log)


async def _serve(settings: Settings, listening: Listening, say: Callable[[str], object], log: Log) -> None:
    async with at_work(settings, log=log) as daemon:
        identity = Identity(daemon.database)
        _expect_safe(listening, identity)
        banner = "" if listening.is_loopback or listening.certificate else "Anybody in this network can read along."
        services = Services(daemon, identity, Audit(daemon.database), banner)
        app = make_app(services, listening.hosts, secure=listening.certificate is not None, log=log)
        config = uvicorn.Config(
            app, log_config=None, access_log=False, server_header=False, date_header=False,
            limit_concurrency=CONNECTIONS, timeout_keep_alive=10, timeout_graceful_shutdown=3, proxy_headers=False,
            ssl_certfile=listening.certificate, ssl_keyfile=listening.key, h11_max_incomplete_event_size=8192,
            ws="none",
        )  # fmt: skip
        with _listener(listening) as listener:
            url = _url(listening, listener)
            _announce(settings.folder, url, identity)
            say(f"{settings.title}: {url}")
            if listening.is_loopback and not identity.has_users():
                say(f"code for the first login, valid once within 10 minutes: {identity.new_code()}")
            notify("READY=1", f"STATUS=serves {url}")
            log.info("station begins", url=url, benches=list(settings.benches))
            try:
                await _until_signal(_Server(config), listener)
            finally:
                log.info("station ends")
                with suppress(OSError):
                    (settings.folder / WHERE).unlink(missing_ok=True)


class _Server(uvicorn.Server):
    """Server that leaves signals alone: that of uvicorn raises them again, which would end the daemon in the middle."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do nothing."""
        yield


async def _until_signal(server: uvicorn.Server, listener: socket.socket) -> None:
    """Serve until SIGINT or SIGTERM."""
    loop = asyncio.get_running_loop()

    def end() -> None:
        server.should_exit = True

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end)
    try:
        await server.serve([listener])
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)


def _expect_safe(listening: Listening, identity: Identity) -> None:
    """Raise InputError for an address in a network without users and TLS, unless this is wanted explicitly."""
    if listening.is_loopback or listening.insecure:
        return
    lacking = [] if identity.has_users() else ["users (bench users add NAME --role ROLE)"]
    lacking += [] if listening.certificate else ["a certificate (--certificate FILE --key FILE)"]
    if lacking:
        raise InputError(
            f"--host {listening.host}: an address in a network needs {' and '.join(lacking)}; or --insecure, with a "
            "banner on all pages"
        )


def _listener(listening: Listening) -> socket.socket:
    family = socket.AF_INET6 if ":" in listening.host else socket.AF_INET
    try:
        return socket.create_server((listening.host, listening.port), family=family, backlog=256)
    except OSError as problem:
        address = f"{listening.host}:{listening.port}"
        raise BenchError(f"{address} cannot be used ({problem}); choose another --port") from None


def _url(listening: Listening, listener: socket.socket) -> str:
    scheme = "https" if listening.certificate else "http"
    host = f"[{listening.host}]" if ":" in listening.host else listening.host
    return f"{scheme}://{host}:{listener.getsockname()[1]}/"


def _announce(folder: Path, url: str, identity: Identity) -> None:
    """Write the address, and at the first start a token, for the commands of this user. Raises StoreError."""
    token = folder / TOKEN
    if not token.exists() or identity.of_token(token.read_text("ascii").strip()) is None:
        descriptor = os.open(token, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(identity.new_token(_user(), "commands of this user", EVERYTHING, DAYS))
    write_atomically(folder / WHERE, json.dumps({"url": url, "pid": os.getpid()}).encode())


def _user() -> str:
    import getpass

    return getpass.getuser()
