"""A mosquitto with the shipped configuration, and subscribers to it."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import paho.mqtt.client as paho
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from bench.clock import Stopwatch
from tests.support.runs import ROOT
from tests.support.served import free_port

USERS = ("station", "dashboard", "anna")
_pause = threading.Event().wait
_program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"


class Received(NamedTuple):
    """Message as a subscriber has received it; `content` is its JSON, or None if it is empty."""

    topic: str
    content: Any
    retained: bool


class Port(NamedTuple):
    """Broker without a certificate."""

    port: int
    tls: bool = False


class Broker:
    """Broker on a port of the loopback interface, with users whose passwords are their names, or open to everybody."""

    def __init__(self, folder: Path, *, tls: bool = False, is_open: bool = False) -> None:
        self.folder, self.tls, self.port = folder, tls, free_port()
        folder.mkdir(parents=True, exist_ok=True)
        self._process: subprocess.Popen[bytes] | None = None
        if is_open:
            kept = f"persistence true\npersistence_location {folder}/\n"
            (folder / "mosquitto.conf").write_text(
                f"listener {self.port} 127.0.0.1\nallow_anonymous true\nuser root\n{kept}max_queued_messages 100000\n"
            )
            return
        shutil.copy(ROOT / "config/services/mosquitto.acl", folder / "bench.acl")
        for name in USERS:
            create = [] if (folder / "bench.passwords").exists() else ["-c"]
            subprocess.run(["mosquitto_passwd", *create, "-b", folder / "bench.passwords", name, name], check=True)
        if tls:
            make_certificates(folder / "certs")
        text = (ROOT / "config/services/mosquitto.conf").read_text()
        text = text.replace("8883 192.0.2.10", f"{self.port} 127.0.0.1").replace("/etc/mosquitto", str(folder))
        text = text.replace("/var/lib/mosquitto/", f"{folder}/")
        lines = [
            line
            for line in text.splitlines()
            if tls or not line.startswith(("cafile", "certfile", "keyfile", "tls", "require"))
        ]
        (folder / "mosquitto.conf").write_text("\n".join([*lines, "user root", "sys_interval 0", ""]))

    def start(self) -> None:
        """Start it, and wait until it answers."""
        with (self.folder / "mosquitto.log").open("ab") as log:
            self._process = subprocess.Popen(
                [_program, "-c", self.folder / "mosquitto.conf", "-v"], stdout=log, stderr=log
            )
        watch = Stopwatch()
        while True:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return
            assert self._process.poll() is None, (self.folder / "mosquitto.log").read_text()
            assert watch.elapsed_s() < 10
            _pause(0.05)

    def stop(self) -> None:
        """Stop it; sessions and retained messages are kept on the disk."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(10)
            self._process = None


@contextmanager
def broker(folder: Path, *, tls: bool = False, is_open: bool = False) -> Iterator[Broker]:
    """A running broker, until the block ends."""
    made = Broker(folder, tls=tls, is_open=is_open)
    made.start()
    try:
        yield made
    finally:
        made.stop()


class Subscriber:
    """Client with a session that outlives its connections and the broker; it keeps all that it receives."""

    def __init__(self, of: Broker, user: str = "dashboard", topic: str = "#") -> None:
        self.received: list[Received] = []
        self.refused: list[str] = []
        self._topic, self._subscribed = topic, threading.Event()
        self._client = paho.Client(paho.CallbackAPIVersion.VERSION2, f"test-{user}", protocol=paho.MQTTv5)
        self._client.username_pw_set(user, user)
        if of.tls:
            certificates = of.folder / "certs"
            self._client.tls_set(
                str(certificates / "ca.pem"), str(certificates / "client.pem"), str(certificates / "client.key")
            )
        self._client.reconnect_delay_set(0.1, 0.2)
        self._client.on_message = self._take
        self._client.on_connect = lambda *_: self._client.subscribe(topic, 1)
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_publish = self._published
        properties = Properties(PacketTypes.CONNECT)
        properties.SessionExpiryInterval = 3600
        self._client.connect(
            "localhost" if of.tls else "127.0.0.1", of.port, 30, clean_start=False, properties=properties
        )
        self._client.loop_start()
        assert self._subscribed.wait(10)

    def _take(self, _client: Any, _data: Any, message: paho.MQTTMessage) -> None:
        content = json.loads(message.payload) if message.payload else None
        self.received.append(Received(message.topic, content, message.retain))

    def _published(self, _client: Any, _data: Any, _mid: int, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self.refused.append(str(reason))

    def publish(self, topic: str, content: Any, *, retain: bool = False) -> None:
        """Publish JSON, and wait until the broker has acknowledged it."""
        self._client.publish(topic, json.dumps(content, default=str), 1, retain).wait_for_publish(10)

    @property
    def is_connected(self) -> bool:
        """True from an answer of the broker until the connection has ended, and all that came over it is read."""
        return self._client.is_connected()

    def of(self, ending: str) -> list[Any]:
        """Return the contents of what was received on topics with an ending, in order."""
        return [each.content for each in list(self.received) if each.topic.endswith(ending)]

    def until(self, holds: Callable[[], Any], within_s: float = 30.0) -> Any:
        """Wait until a condition holds, and return its value."""
        watch = Stopwatch()
        while not (found := holds()):
            assert watch.elapsed_s() < within_s, self.received[-20:]
            _pause(0.05)
        return found

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()
        self._client._reset_sockets(sockpair_only=True)  # which paho leaves to the garbage collector


@contextmanager
def subscribed(of: Broker, user: str = "dashboard", topic: str = "#") -> Iterator[Subscriber]:
    """A subscriber, until the block ends."""
    made = Subscriber(of, user, topic)
    try:
        yield made
    finally:
        made.close()


def make_certificates(folder: Path) -> None:
    """Write two authorities, and certificates of the first one: of `localhost`, and of a client."""
    folder.mkdir(parents=True)
    for name in ("ca", "other"):
        _openssl(
            folder, f"req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN={name} -keyout {name}.key -out {name}.pem"
        )
    (folder / "names").write_text("subjectAltName=DNS:localhost\n")
    for name in ("broker", "client"):
        _openssl(folder, f"req -newkey rsa:2048 -nodes -subj /CN={name} -keyout {name}.key -out {name}.csr")
        _openssl(folder, f"x509 -req -in {name}.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile names "
                         f"-out {name}.pem")  # fmt: skip
        (folder / f"{name}.key").chmod(0o600)


def tls_settings(authority: str = "ca", **more: str) -> dict[str, str]:
    """Return settings `tls` of a station beside the folder `broker`."""
    own = {"certificate": "broker/certs/client.pem", "key": "broker/certs/client.key"}
    return {"ca": f"broker/certs/{authority}.pem", **own, **more}


def _openssl(folder: Path, words: str) -> None:
    subprocess.run(["openssl", *words.split()], cwd=folder, check=True, capture_output=True)


def station_file(folder: Path, of: Any, bench: str = "simulated", **more: Any) -> str:
    """Write `station.yaml` with a station that publishes to the `port` of a broker, and return its name."""
    password = folder / "mqtt.password"
    password.write_text("station\n")
    password.chmod(0o600)
    mqtt = {
        "host": "localhost" if of.tls else "127.0.0.1", "port": of.port, "station": "lab3", "user": "station",
        "password_file": password.name, **more,
    }  # fmt: skip
    text = {
        "schema": "itb-station/1",
        "title": "Laboratory 3",
        "benches": {"demo": {"file": bench}},
        "sequences": "own",
        "mqtt": mqtt,
    }
    (folder / "station.yaml").write_text(json.dumps(text))
    return "station.yaml"
