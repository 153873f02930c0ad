"""MQTT as a part of the station: starts the publisher, sends it what is shown, and obeys commands."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from importlib.metadata import version

from bench.clock import wall_utc
from bench.errors import BenchError
from bench.station.daemon import Daemon
from bench.station.mqtt.first import until_one_ends
from bench.station.mqtt.orders import AT_MOST_EVERY_S, Orders
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.shown import About, Show
from bench.station.mqtt.start import Start
from bench.station.mqtt.topics import Topics
from bench.station.part import Part
from bench.station.runs.live import LiveRun
from bench.station.view import station_view

SHOW_EVERY_S = 1.0
LONGEST_LINE = 64 * 1024
InWords = Callable[[LiveRun], Mapping[str, str]]


class Mqtt(Part):
    """Publisher of a station: a process of its own, started again when it ends.

    `in_words` returns what a run does, by languages.
    """

    every_s = 10.0

    def __init__(self, daemon: Daemon, settings: MqttSettings, in_words: InWords = lambda _: {}) -> None:
        super().__init__()
        self._daemon, self._settings, self._in_words = daemon, settings, in_words
        benches = daemon.settings
        about = {name: About(benches.zones.get(name, ""), benches.recorded.get(name, "")) for name in benches.benches}
        self._show = Show(settings, version("inertial-test-bench"), about, self._words)
        self._orders = Orders(daemon.database, daemon.catalogue, settings.command_users)
        self._topics = Topics(settings.station)

    async def look(self) -> None:
        """Work with one process until it ends. Raises BenchError then."""
        async with self._started() as process:
            await until_one_ends(self._feed(process), self._listen(process))
        raise BenchError(self.problem or "the publisher has ended; it is started again")

    @asynccontextmanager
    async def _started(self) -> AsyncIterator[asyncio.subprocess.Process]:
        settings = self._daemon.settings
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "bench.station.mqtt.publisher", stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE, limit=LONGEST_LINE,
        )  # fmt: skip
        benches = {str(file): name for name, file in settings.benches.items()}
        start = Start(
            self._settings, settings.folder, settings.runs, settings.title, version("inertial-test-bench"), benches
        )
        try:
            _send(process, start.line())
            yield process
        finally:
            _send(process, b'{"end": true}\n')
            with suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), 4.0)
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def _feed(self, process: asyncio.subprocess.Process) -> None:
        """Send the view of the station once a second, unless the publisher has not read the last one yet."""
        while True:
            begun = {name: live.begun for name, live in self._daemon.live.runs.items()}
            if process.stdin is not None and not process.stdin.transport.get_write_buffer_size():
                shown = self._show.of(station_view(self._daemon, wall_utc()), begun, self._daemon.address)
                _send(process, json.dumps(shown._asdict()).encode() + b"\n")
            await asyncio.sleep(SHOW_EVERY_S)

    def _words(self, run: str) -> Mapping[str, str]:
        live = self._daemon.live.runs.get(run)
        return self._in_words(live) if live is not None else {}

    async def _listen(self, process: asyncio.subprocess.Process) -> None:
        """Take problems and commands, one after the other, until the process ends."""
        assert process.stdout is not None  # noqa: S101  a pipe was asked for
        while line := await process.stdout.readline():
            try:
                found = json.loads(line)
            except ValueError:  # it was killed while it wrote
                raise BenchError("the publisher has ended; it is started again") from None
            if found["kind"] == "problem":
                self.problem = found["text"]
            elif found["kind"] == "command":
                user = found["user"]
                reply = await self._orders.obey(user, found["payload"], retained=found["retained"])
                replies = [[self._topics.replies(user), reply.payload()]]
                _send(process, json.dumps({"replies": replies}).encode() + b"\n")
                await asyncio.sleep(AT_MOST_EVERY_S)


def _send(process: asyncio.subprocess.Process, line: bytes) -> None:
    if process.stdin is not None and not process.stdin.is_closing():
        process.stdin.write(line)
