"""Process of the publisher: between the broker and the station, which sends lines of JSON to its standard input.

It ends without a word when the station is killed, so that the broker publishes the last will.
"""

from __future__ import annotations

import asyncio
import json
import os
import platform
import resource
import signal
import sys
from contextlib import closing
from typing import Any

import aiomqtt
from paho.mqtt.subscribeoptions import SubscribeOptions

from bench.clock import wall_utc
from bench.station.mqtt.connection import Client, client, connected_always
from bench.station.mqtt.first import until_one_ends
from bench.station.mqtt.messages import Status
from bench.station.mqtt.outbox import Outbox
from bench.station.mqtt.positions import Positions
from bench.station.mqtt.start import Start
from bench.station.mqtt.topics import Topics

LOOK_EVERY_S = 0.5
STATUS_EVERY_S = 60.0
MEMORY_BYTES = 1 << 30
LONGEST_LINE = 1 << 24
LONGEST_COMMAND = 4096


def tell(kind: str, **facts: object) -> None:
    """Send a line to the station; it is short, whatever the broker has sent."""
    short = {key: value[:LONGEST_COMMAND] if isinstance(value, str) else value for key, value in facts.items()}
    sys.stdout.write(f"{json.dumps({'kind': kind, **short})}\n")
    sys.stdout.flush()


class Publisher:
    """Publisher of one station. `shown` are the newest messages by topic, `sent` those that the broker has."""

    def __init__(self, start: Start) -> None:
        self._start, self._settings, self._topics = start, start.settings, Topics(start.settings.station)
        self._positions = Positions(start.folder)
        self._outbox = Outbox(start.runs, start.benches, self._positions, self._topics)
        self._retained: dict[str, str] = {}
        self._readings: dict[str, str] = {}
        self._replies: list[tuple[str, str]] = []
        self._news = asyncio.Event()

    def take(self, line: dict[str, Any]) -> None:
        """Take what the station sends; newer messages replace those that were not sent yet."""
        self._retained |= line.get("retained", {})
        self._readings |= line.get("readings", {})
        self._replies = [*self._replies, *map(tuple, line.get("replies", ()))][-100:]
        self._news.set()

    async def work(self) -> None:
        """Connect again and again, until cancelled; it can be called once."""
        with closing(self._positions):
            await connected_always(self._connected, self._lost)

    def _lost(self, problem: Exception) -> None:
        tell("problem", text=f"broker {self._settings.host}: {problem}; it is tried again, no event is lost")

    async def _connected(self) -> None:
        number = self._positions.next_connection()
        broker = client(self._settings, self._of(number, "offline").model_copy(update={"at": None}))
        async with broker:
            await asyncio.to_thread(self._outbox.connected)
            try:
                await until_one_ends(
                    self._status(broker, number), self._states(broker), self._events(broker), self._commands(broker)
                )
            except asyncio.CancelledError:
                await broker.deliver([(self._topics.status, self._of(number, "offline"))], retain=True)
                raise

    def _of(self, number: int, status: Any) -> Status:
        start = self._start
        return Status(
            status=status, bd_seq=number, title=start.title, version=start.version, computer=platform.node(),
            at=wall_utc(),
        )  # fmt: skip

    async def _status(self, broker: Client, number: int) -> None:
        while True:
            await broker.deliver([(self._topics.status, self._of(number, "online"))], retain=True)
            tell("problem", text="")
            await asyncio.sleep(STATUS_EVERY_S)

    async def _states(self, broker: Client) -> None:
        """Publish what has changed."""
        sent: dict[str, str] = {}
        while True:
            self._news.clear()
            changed = {topic: text for topic, text in self._retained.items() if sent.get(topic) != text}
            await broker.deliver(changed.items(), retain=True)
            sent |= changed
            replies, self._replies = self._replies, []
            await broker.deliver(replies)
            readings, self._readings = self._readings, {}
            for topic, text in readings.items():
                await broker.publish(topic, text, qos=0)
            await self._news.wait()

    async def _events(self, broker: Client) -> None:
        """Publish the journals; a position is noted when the broker has acknowledged all before it."""
        while True:
            count = 0
            for batch in await asyncio.to_thread(lambda: list(self._outbox.batches())):
                await broker.deliver(batch.messages)
                self._positions.move(batch.run, batch.position)
                count += len(batch.messages)
            if not count:
                await asyncio.sleep(LOOK_EVERY_S)

    async def _commands(self, broker: Client) -> None:
        """Pass commands on to the station. Any other message ends the connection: this client asks for none."""
        users = {self._topics.commands(user): user for user in self._settings.command_users}
        for topic in users:
            await broker.subscribe(topic, options=SubscribeOptions(qos=1, retainAsPublished=True))
        async for message in broker.messages:
            user = users.get(message.topic.value)
            if user is None:
                raise aiomqtt.MqttError(f"the broker sent a message that nobody asked for ({message.topic})")
            payload = message.payload
            text = payload.decode("utf-8", "replace") if len(payload) <= LONGEST_COMMAND else ""
            tell("command", user=user, retained=message.retain, payload=text)


async def main() -> None:
    """Work until the station says that it ends, or is killed."""
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: tell("note", text=str(context.get("message"))))
    reader = asyncio.StreamReader(limit=LONGEST_LINE)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    publisher = Publisher(Start.of_line(await reader.readline()))
    working = asyncio.create_task(publisher.work())
    working.add_done_callback(_failed)
    while line := await reader.readline():
        found = json.loads(line)
        if found.get("end"):
            working.cancel()
            await asyncio.wait([working], timeout=3.0)
            break
        publisher.take(found)
    os._exit(0)  # a thread may still be connecting


def _failed(working: asyncio.Task[None]) -> None:
    """End the process after an error of this program; the station starts it again."""
    if not working.cancelled():
        tell("problem", text=f"the publisher ended: {working.exception()!r}")
        os._exit(2)


def run() -> None:
    """Run the process, with little memory and behind everything else."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the station decides
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    os.nice(10)
    asyncio.run(main())


if __name__ == "__main__":
    run()
