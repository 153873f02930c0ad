"""A route at work: it sends its deliveries one after the other, and delays nothing but itself."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from contextlib import suppress

from bench.clock import wall_utc
from bench.errors import BenchError
from bench.station.alerts.send import LIMIT_S
from bench.station.alerts.settings import Route
from bench.station.alerts.table import AlertTable, Delivery
from bench.station.alerts.words import Message
from bench.station.part import Part
from bench.store.tried import note_tried

OVER_S = 5.0  # beyond the limit that the program has for itself
NO_ANSWER = f"no answer within {LIMIT_S} s; it may have been sent"


class AlertError(BenchError):
    """Alert that was not sent."""

    code = "alert"


class Sending(Part):
    """Sender of one route. `failures` and `successes` count since the start of the station."""

    every_s = 1.0
    limit_s = LIMIT_S + OVER_S

    def __init__(self, route: Route, table: AlertTable, compose: Callable[[Delivery], Message]) -> None:
        super().__init__()
        self.route, self._table, self._compose = route, table, compose
        self.failures = self.successes = 0
        self.failure = ""

    async def look(self) -> None:
        """Send the next delivery, if any. Raises AlertError while the last one has failed."""
        delivery = self._table.next_due(self.route.name, wall_utc())
        if delivery is not None:
            self._table.begin(delivery)
            problem = await self._send(self._compose(delivery))
            if problem:
                self._table.not_sent(delivery, problem, wall_utc(), again=problem == NO_ANSWER)
            else:
                self._table.sent(delivery)
                self._note_tried()
            self.wake()  # for the next one
        if self.failure:
            raise AlertError(self.failure)

    async def test(self, message: Message) -> str:
        """Send a message at once; return the problem, or "". Raises StoreError if its success cannot be recorded."""
        problem = await self._send(message)
        if not problem:
            self._note_tried()
        self.wake()  # to show the problem, or that it is gone
        return problem

    async def _send(self, message: Message) -> str:
        problem = await send(self.route, message, self.limit_s)
        if problem:
            self.failures += 1
            self.failure = (
                f"the last alert was not sent at {wall_utc():%Y-%m-%d %H:%M} UTC: {problem.rstrip('.')}. Test the route"
            )
        else:
            self.successes, self.failure = self.successes + 1, ""
        return problem

    def _note_tried(self) -> None:
        """Record for the preflight of unattended runs that the route works."""
        note_tried("alert", self.route.key)


async def send(route: Route, message: Message, limit_s: float = LIMIT_S + OVER_S) -> str:
    """Send a message in a process of its own, which is killed when it takes too long."""
    url = route.url.get_secret_value()
    content = json.dumps({"url": url, "title": message.title, "body": message.body}).encode()
    try:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "bench.station.alerts.send", stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
    except OSError as problem:
        return f"the program that sends it cannot be started ({problem.strerror})"
    try:
        answer, _ = await asyncio.wait_for(process.communicate(content), limit_s)
    except TimeoutError:
        return NO_ANSWER
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
    if process.returncode == 0:
        return answer.decode(errors="replace")
    return NO_ANSWER if process.returncode == -14 else f"the program that sends it ended with {process.returncode}"
