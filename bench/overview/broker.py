"""Subscription to what all stations of a broker publish. Nothing is ever published."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from pydantic import ValidationError

from bench.clock import wall_utc
from bench.errors import BenchError, InputError
from bench.overview.fold import Overview
from bench.station.mqtt.connection import Client, connected_always, connecting
from bench.station.mqtt.first import until_one_ends
from bench.station.mqtt.settings import MqttSettings, with_files

TOPICS = (
    ("bench/+/status", 1), ("bench/+/+/state", 1), ("bench/+/+/questions", 1), ("bench/+/+/alarms", 1),
    ("bench/+/+/results", 1), ("bench/+/+/readings/+", 0),
)  # fmt: skip
LONGEST_PACKET = 256 * 1024  # a longer one is not sent by the broker
SETTLED_S = 5.0  # until all retained messages are there
AGAIN_S = 600.0  # retained messages are read again
LONGEST_WAIT_S = 10.0  # a person looks at the page
SCHEMES = {"mqtt": False, "mqtts": True}
PASSWORD_VARIABLE = "BENCH_BROKER_PASSWORD"  # noqa: S105  its name


class BrokerFiles(NamedTuple):
    """Files for a broker: password, certificates that it is verified by, and certificate and key of this client."""

    password: Path | None = None
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None


class Address(NamedTuple):
    """Address of a broker. `password` is "" if it is in a file of the settings."""

    url: str
    settings: MqttSettings
    password: str = ""


def address_of(url: str, files: BrokerFiles, password: str = "") -> Address:
    """Return the address of a broker by its URL, such as mqtts://user@broker.example.org. Raises InputError.

    `password` is that of the environment.
    """
    try:
        found = urlsplit(url)
        host, port = found.hostname, found.port or 0
    except ValueError as problem:
        raise InputError(f"--broker {url}: {problem}") from None
    if found.password is not None:
        raise InputError(
            "--broker: a password in a command line is seen by all users of this computer; give --password-file FILE, "
            f"or the variable {PASSWORD_VARIABLE}"
        )
    if found.scheme not in SCHEMES or not host or found.path.strip("/") or found.query or found.fragment:
        raise InputError(f"--broker {url}: give mqtt://HOST, mqtts://HOST or mqtts://USER@HOST:PORT")
    named = {"ca": files.ca, "certificate": files.certificate, "key": files.key}
    tls = {name: str(path.absolute()) for name, path in named.items() if path is not None}
    if tls and not SCHEMES[found.scheme]:
        raise InputError(f"--broker {url}: certificates are for mqtts://")
    user, has_password = unquote(found.username or ""), files.password is not None or bool(password)
    if has_password and not user:
        raise InputError(f"--broker {url}: a password belongs to a user: {found.scheme}://USER@{host}")
    settings: dict[str, Any] = {"host": host, "port": port, "station": "overview", "user": user}
    if SCHEMES[found.scheme]:
        settings["tls"] = tls
    if has_password:
        settings["password_file"] = str((files.password or Path("/dev/null")).absolute())
    try:
        made = MqttSettings.model_validate(settings)
    except ValidationError as problem:
        raise InputError(f"--broker {url}: {problem.errors()[0]['msg'].removeprefix('Value error, ')}") from None
    if files.password is None:
        made = made.model_copy(update={"password_file": ""})
    return Address(f"{found.scheme}://{host}:{made.port_used}", with_files(made, Path()), password)


class Listener(Client):
    """Client that hands each message over when it comes, so that no queue grows."""

    def __init__(self, take: Callable[[str, bytes, bool], object], **arguments: Any) -> None:
        self._take = take
        super().__init__(**arguments)

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:  # which no honest broker sends
            return
        self._take(topic, message.payload, bool(message.retain))


class Subscription:
    """Connection to a broker, made again whenever it is lost. `problem` is why there is none; empty while there is.

    `since` is the begin of the present connection, or of its loss.
    """

    def __init__(self, address: Address, overview: Overview) -> None:
        self.address, self._overview = address, overview
        self.problem = "no answer yet"
        self.since: datetime = wall_utc()

    async def work(self) -> None:
        """Subscribe again and again, until cancelled."""
        await connected_always(self._connected, self._away, LONGEST_WAIT_S)

    def _away(self, problem: Exception) -> None:
        if not self.problem:
            self.since = wall_utc()
        self.problem = str(problem) or "the connection was lost"
        self._overview.disconnected(wall_utc())

    async def _connected(self) -> None:
        arguments = connecting(
            self.address.settings, f"bench-overview-{secrets.token_hex(6)}", LONGEST_PACKET, self.address.password
        )
        async with Listener(self._take, **arguments) as listener:
            await until_one_ends(self._subscribed(listener), self._until_lost(listener))

    async def _subscribed(self, listener: Listener) -> None:
        """Subscribe, and from time to time again: the broker then sends all retained messages."""
        is_again = False
        while True:
            self._overview.subscribed(wall_utc(), again=is_again)
            granted = await listener.subscribe(list(TOPICS))
            if refused := [str(each) for each in granted if getattr(each, "is_failure", False)]:
                raise BenchError(f"the broker refuses the subscription ({refused[0]}); see its access list")
            if self.problem:
                self.problem, self.since = "", wall_utc()
            is_again = True
            await asyncio.sleep(SETTLED_S)
            self._overview.settled()
            await asyncio.sleep(AGAIN_S)

    @staticmethod
    async def _until_lost(listener: Listener) -> None:
        async for _ in listener.messages:  # there are none; it raises when the connection is lost
            pass

    def _take(self, topic: str, payload: bytes, retained: bool) -> None:
        self._overview.take(topic, payload, wall_utc(), retained=retained)
