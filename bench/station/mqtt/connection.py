"""Connection to a broker: the client with its last will, and how long to wait before the next attempt."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from pathlib import Path
from random import SystemRandom
from typing import Any, TypeVar

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from bench.clock import Stopwatch
from bench.errors import BenchError, InputError
from bench.station.mqtt.messages import Message, Status
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.topics import Topics

TIMEOUT_S = 10.0
KEEP_ALIVE_S = 30
LONGEST_PACKET = 64 * 1024
FIRST_WAIT_S, LONGEST_WAIT_S = 1.0, 60.0
OF_USE_S = 30.0  # a connection that lasted longer
IN_FLIGHT = 20
T = TypeVar("T")
_random = SystemRandom()
_quiet = logging.getLogger("bench.mqtt")  # a broker must not fill a log
_quiet.disabled = True


class Refused(aiomqtt.MqttError):
    """The broker has acknowledged a message and refused it, as for a topic that its access list does not allow."""


class Client(aiomqtt.Client):
    """Client that keeps why the broker has refused a message; aiomqtt takes it for published."""

    refusal = ""

    def _on_publish(self, client: Any, userdata: Any, mid: int, reason_code: ReasonCode, properties: Any) -> None:
        if reason_code.is_failure:
            self.refusal = str(reason_code)
        super()._on_publish(client, userdata, mid, reason_code, properties)

    async def deliver(self, messages: Iterable[tuple[str, Message | str]], *, retain: bool = False) -> None:
        """Publish messages in order and return when all are acknowledged. Raises MqttError."""
        for some in _parts(list(messages), IN_FLIGHT):
            await self._deliver(some, retain=retain)

    async def _deliver(self, messages: Sequence[tuple[str, Message | str]], *, retain: bool) -> None:
        sending = [
            asyncio.create_task(self.publish(topic, _payload(message), qos=1, retain=retain))
            for topic, message in messages
        ]
        try:
            await asyncio.gather(*sending)
        finally:
            for each in sending:
                each.cancel()
            await asyncio.gather(*sending, return_exceptions=True)
        if self.refusal:
            topics = ", ".join(sorted({topic for topic, _ in messages})[:3])
            raise Refused(f"the broker refuses messages ({self.refusal}) to {topics}; see its access list")


def _parts(messages: list[T], count: int) -> Iterator[list[T]]:
    """Yield parts of a list."""
    for first in range(0, len(messages), count):
        yield messages[first : first + count]


def _payload(message: Message | str) -> str:
    return message if isinstance(message, str) else message.payload()


def client(settings: MqttSettings, will: Status) -> Client:
    """Return a client whose last will is a status. Raises InputError, and OSError for files that cannot be read."""
    made = Client(
        **connecting(settings, f"bench-{settings.station}", LONGEST_PACKET),
        will=aiomqtt.Will(Topics(settings.station).status, will.payload(), qos=1, retain=True),
        max_queued_incoming_messages=20, max_queued_outgoing_messages=5 * IN_FLIGHT,
    )  # fmt: skip
    made.pending_calls_threshold = 5 * IN_FLIGHT
    return made


def connecting(settings: MqttSettings, identifier: str, longest_packet: int, password: str = "") -> dict[str, Any]:
    """Return the arguments of a client that has no use for packets longer than some bytes.

    Without `password`, it is in the file of the settings. Raises InputError, and OSError for files that cannot be read.
    """
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    properties.MaximumPacketSize = longest_packet
    properties.ReceiveMaximum = IN_FLIGHT
    return {
        "hostname": settings.host, "port": settings.port_used, "username": settings.user or None,
        "password": password or _password(settings), "identifier": identifier,
        "protocol": aiomqtt.ProtocolVersion.V5, "clean_start": True, "timeout": TIMEOUT_S, "keepalive": KEEP_ALIVE_S,
        "properties": properties, "tls_context": _tls(settings), "logger": _quiet,
    }  # fmt: skip


def _password(settings: MqttSettings) -> str | None:
    return Path(settings.password_file).read_text("utf-8").rstrip("\n") if settings.password_file else None


def _tls(settings: MqttSettings) -> ssl.SSLContext | None:
    if settings.tls is None:
        return None
    try:
        context = ssl.create_default_context(cafile=settings.tls.ca or None)
        if settings.tls.certificate:
            context.load_cert_chain(settings.tls.certificate, settings.tls.key)
    except ssl.SSLError as problem:
        raise InputError(f"mqtt.tls: a file is not a certificate or key in PEM format ({problem})") from None
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


async def connected_always(
    connect: Callable[[], Awaitable[None]], lost: Callable[[Exception], object], longest_wait_s: float = LONGEST_WAIT_S
) -> None:
    """Connect again whenever `connect` fails or ends, until cancelled; `lost` is called with each error."""
    backoff = Backoff()
    while True:
        watch = Stopwatch()
        try:
            await connect()
        except (aiomqtt.MqttError, BenchError, OSError, ValueError) as problem:
            if (task := asyncio.current_task()) is not None and task.cancelling():
                raise asyncio.CancelledError from problem  # the client failed while it was closed
            lost(problem)
        if watch.elapsed_s() > OF_USE_S:
            backoff.reset()
        await asyncio.sleep(min(backoff.next_s(), longest_wait_s))


class Backoff:
    """Times to wait between attempts: doubled after each, up to a minute, and shortened at random by up to half."""

    def __init__(self) -> None:
        self._longest_s = FIRST_WAIT_S

    def next_s(self) -> float:
        """Return the time to wait before the next attempt in s."""
        wait_s = self._longest_s * _random.uniform(0.5, 1.0)
        self._longest_s = min(2 * self._longest_s, LONGEST_WAIT_S)
        return wait_s

    def reset(self) -> None:
        """Begin again, after a connection that was of use."""
        self._longest_s = FIRST_WAIT_S
