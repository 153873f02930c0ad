"""All of the alerts of a station: its parts, the test of a route, acknowledgements."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import NamedTuple
from urllib.parse import quote

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.alerts.rounds import Rounds
from bench.station.alerts.route import Sending
from bench.station.alerts.settings import AlertSettings, Route
from bench.station.alerts.table import Alert, AlertTable, Delivery
from bench.station.alerts.watch import Watch, Watched
from bench.station.alerts.words import Message, Remarks, message
from bench.station.part import Part
from bench.station.settings import WHERE
from bench.station.storage.database import Database
from bench.store.tried import last_tried


class Tested(NamedTuple):
    """Result of a test of a route: the problem, or ""."""

    route: str
    problem: str


class Alerts:
    """Alerts of a station, used in the event loop of the daemon."""

    def __init__(self, alerts: AlertSettings, database: Database, watched: Watched) -> None:
        self.settings, self._station = alerts, watched.settings
        self.table = AlertTable(database, alerts.routes)
        self.sending = {name: Sending(route, self.table, self._compose) for name, route in alerts.routes.items()}
        self.watch = Watch(alerts.entry, self.table, watched)
        self._rounds = Rounds(alerts, self.table, watched)

    def parts(self) -> Iterator[tuple[str, Part]]:
        """Yield the parts of the daemon with their names."""
        yield "alerts", self.watch
        yield "alert rounds", self._rounds
        for name, each in self.sending.items():
            yield f"alert route {name}", each

    async def test(self, route: str | None, by: str) -> list[Tested]:
        """Send a test by a route or all, and wait until it is sent. Raises InputError."""
        if route is not None and route not in self.sending:
            raise InputError(f"there is no route '{route}'; the station has {', '.join(self.sending)}")
        chosen = [self.sending[route]] if route is not None else list(self.sending.values())
        return list(await asyncio.gather(*(self._test(each, by) for each in chosen)))

    async def _test(self, sending: Sending, by: str) -> Tested:
        route = sending.route
        values = {"route": route.name, "by": by}
        problem = await sending.test(self._message("test", values, "", route, Remarks()))
        return Tested(route.name, problem)

    def acknowledge(self, id_: str, by: str) -> Alert:
        """Acknowledge an alert. Raises InputError."""
        return self.table.acknowledge(id_, by, wall_utc())

    def tried(self) -> Mapping[str, datetime | None]:
        """Return when each route has worked for the last time."""
        return {name: last_tried("alert", route.key) for name, route in self.settings.routes.items()}

    def text(self, alert: Alert, language: str = "en") -> Message:
        """Return the message of an alert."""
        remarks = Remarks(alert.times, alert.cause.historical)
        return message(
            self._station.title, alert.cause.text, alert.cause.values, self._link(alert.cause.link), language, remarks
        )

    def _compose(self, delivery: Delivery) -> Message:
        alert, route = self.table.alert(delivery.alert), self.settings.routes[delivery.route]
        remarks = Remarks(alert.times, alert.cause.historical, delivery.again, delivery.after)
        return self._message(alert.cause.text, alert.cause.values, alert.cause.link, route, remarks)

    def _message(self, text: str, values: Mapping[str, str], link: str, route: Route, remarks: Remarks) -> Message:
        return message(self._station.title, text, values, self._link(link), route.entry.language, remarks)

    def _link(self, place: str) -> str:
        """Return the address of a page: that of the settings, or that at which the station answers now."""
        page = self.settings.entry.page
        if not page:
            try:
                page = str(json.loads((self._station.folder / WHERE).read_text())["url"])
            except (OSError, ValueError, KeyError, TypeError):
                page = ""
        return f"{page}{quote(place)}"
