"""Listening: the address of a server, what it must have there, and serving an application until a signal."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import uvicorn
from starlette.types import ASGIApp

from bench.client.address import LOOPBACK, TOKEN, WHERE, announcement
from bench.errors import BenchError, InputError
from bench.files import expect_private, write_atomically
from bench.web.access import EVERYTHING, Person
from bench.web.assets import lacking
from bench.web.connections import Connection, Handshake, connection_of
from bench.web.guards import HEADER_LIMIT_BYTES
from bench.web.identity import Identity

DAYS = 3650
ACCEPTED_AT_ONCE = 50  # so that a flood of them holds nothing else up
BACKLOG = 1024  # beyond it, a connection is tried again after a second


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
        return self.host in LOOPBACK


def server_of(app: ASGIApp, listening: Listening) -> uvicorn.Server:
    """Return the server of an application at an address."""
    return _Server(uvicorn.Config(
        app, log_config=None, access_log=False, server_header=False, date_header=False, http=Connection,
        timeout_keep_alive=10, timeout_graceful_shutdown=3, proxy_headers=False, ws="none",
        ssl_certfile=listening.certificate, ssl_keyfile=listening.key,
        h11_max_incomplete_event_size=HEADER_LIMIT_BYTES,
    ))  # fmt: skip


@contextmanager
def listening_at(
    where: Listening, identity: Identity, folder: Path, runs: Path, title: str, say: Callable[[str], object]
) -> Iterator[tuple[socket.socket, str]]:
    """Listen until the block ends; yield socket and URL, which `say` writes to the terminal with the first code."""
    with listener_of(where) as listener:
        url = url_of(where, listener)
        announce(folder, runs, url, identity, where.certificate)
        say(f"{title}: {url}")
        if where.is_loopback and not identity.has_users():
            say(f"code for the first login, valid once within 10 minutes: {identity.new_code()}")
        if missing := lacking():
            say(f"the pages lack {', '.join(missing)} and show no live values; in a source checkout: make assets")
        try:
            yield listener, url
        finally:
            with suppress(OSError):
                (folder / WHERE).unlink(missing_ok=True)


class _Server(uvicorn.Server):
    """Server that leaves signals alone: that of uvicorn raises them again, which would end the daemon in the middle."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen; a handshake of TLS counts as a connection."""
        await self.lifespan.startup()
        loop = asyncio.get_running_loop()
        make = Handshake if self.config.ssl is not None else connection_of
        self.servers = [
            await loop.create_server(lambda: make(self), sock=each, backlog=ACCEPTED_AT_ONCE) for each in sockets or []
        ]
        for each in sockets or []:
            each.listen(BACKLOG)
        self.started = True

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do nothing."""
        yield


async def until_signal(server: uvicorn.Server, listener: socket.socket) -> None:
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


def expect_safe(listening: Listening, identity: Identity) -> None:
    """Raise InputError for an address in a network without users and TLS, unless this is wanted explicitly."""
    if listening.is_loopback or listening.insecure:
        return
    lacking = [] if identity.has_users() else ["users (PUT /api/v1/users/NAME with the token of the station)"]
    lacking += [] if listening.certificate else ["a certificate (--certificate FILE --key FILE)"]
    if lacking:
        raise InputError(
            f"--host {listening.host}: an address in a network needs {' and '.join(lacking)}; or --insecure, with a "
            "banner on all pages"
        )


def own_host(listening: Listening) -> tuple[str, ...]:
    """Return the address as a host name, unless it means all addresses of this computer."""
    return () if listening.host in ("0.0.0.0", "::", "") else (listening.host.lower(),)  # noqa: S104  not bound to


def expect_secret(token: Path, key: Path | None) -> None:
    """Raise InputError if others can read a file with a secret; a group may read the key, as on Debian."""
    for path, what, others in ((token, "token", 0o077), (key, "--key", 0o027)):
        if path is not None and path.exists():
            expect_private(path, what, others)


def banner_of(listening: Listening, identity: Identity) -> str:
    """Return the permanent warning of a station that serves a network without users or TLS; "" for none."""
    if listening.is_loopback:
        return ""
    warnings = [] if listening.certificate else ["Anybody in this network can read along and change what is sent."]
    warnings += [] if identity.has_users() else ["This station has no users."]
    return " ".join(warnings)


def listener_of(listening: Listening) -> socket.socket:
    """Return the socket that a server listens at. Raises BenchError if the address cannot be used."""
    family = socket.AF_INET6 if ":" in listening.host else socket.AF_INET
    try:
        listener = socket.create_server((listening.host, listening.port), family=family, backlog=BACKLOG)
    except OSError as problem:
        address = f"{listening.host}:{listening.port}"
        raise BenchError(f"{address} cannot be used ({problem}); choose another --port") from None
    # Connections inherit it: asyncio sets it only where a socket names its protocol, and 40 ms an answer are at stake.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def address_for_others(listening: Listening, url: str) -> str:
    """Return the URL by the first name of the server; "" if it listens at all addresses and has no name."""
    if listening.is_loopback or (own_host(listening) == (listening.host.lower(),) and not listening.hosts):
        return url
    scheme, _, rest = url.partition("://")
    return f"{scheme}://{listening.hosts[0]}:{rest.rpartition(':')[2]}" if listening.hosts else ""


def url_of(listening: Listening, listener: socket.socket) -> str:
    """Return the URL of a server by its address."""
    scheme = "https" if listening.certificate else "http"
    host = f"[{listening.host}]" if ":" in listening.host else listening.host
    return f"{scheme}://{host}:{listener.getsockname()[1]}/"


def announce(folder: Path, runs: Path, url: str, identity: Identity, certificate: Path | None) -> None:
    """Write the address, and at the first start a token, for the commands of this user. Raises StoreError."""
    token = folder / TOKEN
    if not token.exists() or identity.of_token(token.read_text("latin-1").strip()) is None:
        person = Person(_user(), EVERYTHING, "token", is_user=False)
        descriptor = os.open(token, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(identity.new_token(person, "commands of this user", EVERYTHING, DAYS))
    write_atomically(folder / WHERE, announcement(url, runs, certificate))


def _user() -> str:
    import getpass

    return getpass.getuser()
