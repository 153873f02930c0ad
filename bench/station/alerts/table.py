"""Alerts on the disk: an alert and where it is to be sent are rows of the station's database before it is sent."""

from __future__ import annotations

import json
import sqlite3
import uuid
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta
from typing import NamedTuple

from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.alerts.kinds import ENDS, URGENT, Cause, Kind
from bench.station.alerts.settings import Route
from bench.station.storage.database import Database

_UNACKNOWLEDGED = f"acknowledged IS NULL AND kind IN ({','.join('?' * len(URGENT))})"  # with the sorted URGENT
WINDOW = timedelta(minutes=10)  # at most one alert of a kind about one subject is sent within it
TRIED_FOR = timedelta(hours=1)
ESCALATED_FOR = timedelta(days=1)
FIRST_PAUSE_S, LONGEST_PAUSE_S = 10.0, 600.0
_TABLES = """
CREATE TABLE IF NOT EXISTS alert(id TEXT PRIMARY KEY, kind TEXT NOT NULL, subject TEXT NOT NULL, at TEXT NOT NULL,
  due TEXT NOT NULL, count INTEGER NOT NULL, acknowledged TEXT, by TEXT NOT NULL, data TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS alert_by_subject ON alert(kind, subject, due);
CREATE INDEX IF NOT EXISTS alert_by_time ON alert(at);
CREATE TABLE IF NOT EXISTS alert_cause(key TEXT PRIMARY KEY, alert TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS alert_delivery(alert TEXT NOT NULL, route TEXT NOT NULL, state TEXT NOT NULL,
  tries INTEGER NOT NULL, since TEXT NOT NULL, due TEXT NOT NULL, again INTEGER NOT NULL, after TEXT NOT NULL,
  problem TEXT NOT NULL, PRIMARY KEY(alert, route));
CREATE INDEX IF NOT EXISTS alert_delivery_by_state ON alert_delivery(state, route, due);
CREATE INDEX IF NOT EXISTS alert_delivery_by_time ON alert_delivery(since);
CREATE TABLE IF NOT EXISTS alert_since(at TEXT NOT NULL);
"""


class Alert(NamedTuple):
    """Alert: what caused it, how many times within its window, and who has acknowledged it."""

    id: str
    cause: Cause
    at: datetime
    due: datetime
    times: int
    steps: tuple[str, ...]
    acknowledged: datetime | None
    by: str


class Delivery(NamedTuple):
    """Way of an alert by a route. State: waiting, sending, sent, failed, or dropped when it was acknowledged before.

    `again` is true if it may have been sent before, `after` the route on which nobody acknowledged it.
    """

    alert: str
    route: str
    state: str
    tries: int
    since: datetime
    due: datetime
    again: bool
    after: str
    problem: str


class AlertTable:
    """Alerts and their deliveries; each change is durable when its function returns. Raises StoreError."""

    def __init__(self, database: Database, routes: Mapping[str, Route]) -> None:
        self._database, self._routes = database, routes
        with database.transaction() as tables:
            for statement in filter(str.strip, _TABLES.split(";")):
                tables.execute(statement)
            now = wall_utc().isoformat()
            if tables.execute("SELECT 1 FROM alert_since").fetchone() is None:
                tables.execute("INSERT INTO alert_since VALUES (?)", (now,))
            tables.execute(
                "UPDATE alert_delivery SET since = MAX(?, since), due = MAX(?, since) "
                "WHERE state IN ('waiting', 'sending')", (now, now),
            )  # fmt: skip

    def since(self) -> datetime:
        """Return when this station had alerts for the first time; older runs have none."""
        return datetime.fromisoformat(self._database.rows("SELECT at FROM alert_since")[0]["at"])

    def is_known(self, key: str) -> bool:
        """Return True if a cause has an alert."""
        return bool(self._database.rows("SELECT 1 FROM alert_cause WHERE key = ?", key))

    def has_end(self, run: str) -> bool:
        """Return True if a run that did not end well has an alert."""
        return bool(self._database.rows("SELECT 1 FROM alert WHERE kind = ? AND subject = ?", Kind.SAFE_STOP, run))

    def add(self, causes: Iterable[Cause], now: datetime) -> None:
        """Make alerts of causes that have none, and deliveries to the routes of their kind."""
        with self._database.transaction() as tables:
            for cause in causes:
                if tables.execute("SELECT 1 FROM alert_cause WHERE key = ?", (cause.key,)).fetchone() is None:
                    self._add(tables, cause, now)

    def _add(self, tables: sqlite3.Connection, cause: Cause, now: datetime) -> None:
        last = tables.execute(
            "SELECT * FROM alert WHERE kind = ? AND subject = ? ORDER BY due DESC LIMIT 1", (cause.kind, cause.subject)
        ).fetchone()
        due = now if last is None else max(now, datetime.fromisoformat(last["due"]) + WINDOW)
        waits = last is not None and datetime.fromisoformat(last["due"]) > now
        if waits and last["acknowledged"] is None:
            id_, data = last["id"], json.loads(last["data"])
            data = {"cause": cause._asdict(), "steps": [*data["steps"], cause.step]}
            tables.execute("UPDATE alert SET count = count + 1, data = ? WHERE id = ?", (json.dumps(data), id_))
        else:
            id_, data = uuid.uuid4().hex, {"cause": cause._asdict(), "steps": [cause.step]}
            due = datetime.fromisoformat(last["due"]) if waits else due  # that one was never sent
            tables.execute(
                "INSERT INTO alert VALUES (?, ?, ?, ?, ?, 1, NULL, '', ?)",
                (id_, cause.kind, cause.subject, now.isoformat(), due.isoformat(), json.dumps(data)),
            )
            for route in self._routes_of(cause):
                _deliver(tables, id_, route, due)
        tables.execute("INSERT INTO alert_cause VALUES (?, ?)", (cause.key, id_))

    def _routes_of(self, cause: Cause) -> list[str]:
        return [
            name
            for name, route in self._routes.items()
            if cause.kind in route.entry.events
            and not (cause.kind in ENDS and cause.by_program and cause.bench in route.entry.same_person_as)
        ]

    def acknowledge(self, id_: str, by: str, now: datetime) -> Alert:
        """Acknowledge an alert: it is not sent any further. A second time changes nothing. Raises InputError."""
        alert = self.alert(id_)
        with self._database.transaction() as tables:
            _acknowledge(tables, alert.id, by, now)
        return self.alert(id_)

    def answered(self, run: str, step: str | None, now: datetime) -> None:
        """Acknowledge the questions of a step of a run, or all of a run that has ended."""
        asked = self._database.rows(
            "SELECT * FROM alert WHERE kind = ? AND subject = ? AND acknowledged IS NULL", Kind.QUESTION, run
        )
        with self._database.transaction() as tables:
            for row in asked:
                data = json.loads(row["data"])
                left = [each for each in data["steps"] if each != step] if step is not None else []
                text = json.dumps(data | {"steps": left})
                tables.execute("UPDATE alert SET data = ? WHERE id = ?", (text, row["id"]))
                if not left:
                    _acknowledge(tables, row["id"], "answer", now)

    def escalate(self, after: timedelta, now: datetime) -> None:
        """Send urgent alerts that nobody has acknowledged by the next route of each of theirs."""
        marks = ",".join("?" * len(URGENT))
        rows = self._database.rows(
            "SELECT d.* FROM alert_delivery d JOIN alert a ON a.id = d.alert WHERE a.acknowledged IS NULL "  # noqa: S608  only question marks
            f"AND d.since <= ? AND d.since > ? AND a.kind IN ({marks})",
            (now - after).isoformat(), (now - after - ESCALATED_FOR).isoformat(), *sorted(URGENT),
        )  # fmt: skip
        known = {(each.alert, each.route) for row in rows for each in self.deliveries(row["alert"])}
        for row in rows:
            following = self._routes[row["route"]].entry.next if row["route"] in self._routes else None
            if following is not None and (row["alert"], following) not in known:
                known.add((row["alert"], following))
                with self._database.transaction() as tables:
                    _deliver(tables, row["alert"], following, now, after=row["route"])

    def next_due(self, route: str, now: datetime) -> Delivery | None:
        """Return the delivery of a route to be sent next, those that were tried least first.

        A route sends one at a time: one that is still being sent is of a process that died, or its end could not be
        recorded. It is sent again, rather twice than never.
        """
        rows = self._database.rows(
            "SELECT d.* FROM alert_delivery d JOIN alert a ON a.id = d.alert WHERE d.state IN ('waiting', 'sending') "
            "AND d.route = ? AND d.due <= ? AND a.acknowledged IS NULL ORDER BY d.tries, d.since LIMIT 1",
            route, now.isoformat(),
        )  # fmt: skip
        return _delivery(rows[0]) if rows else None

    def begin(self, delivery: Delivery) -> None:
        """Record that a delivery is being sent."""
        self._set(delivery, "sending", tries=delivery.tries + 1)

    def sent(self, delivery: Delivery) -> None:
        """Record that a delivery was sent."""
        self._set(delivery, "sent")

    def not_sent(self, delivery: Delivery, problem: str, now: datetime, *, again: bool) -> None:
        """Record a failure: the delivery is tried again after a pause that doubles, for `TRIED_FOR`."""
        pause_s = min(FIRST_PAUSE_S * 2.0**delivery.tries, LONGEST_PAUSE_S)
        state = "waiting" if now + timedelta(seconds=pause_s) < delivery.since + TRIED_FOR else "failed"
        due = (now + timedelta(seconds=pause_s)).isoformat()
        self._set(delivery, state, problem=problem, due=due, again=int(again or delivery.again))

    def _set(self, delivery: Delivery, state: str, **changes: object) -> None:
        names = "".join(f", {name} = ?" for name in changes)
        with self._database.transaction() as tables:
            tables.execute(
                f"UPDATE alert_delivery SET state = ?{names} WHERE alert = ? AND route = ?",  # noqa: S608  names of columns
                (state, *changes.values(), delivery.alert, delivery.route),
            )

    def alert(self, id_: str) -> Alert:
        """Return an alert. Raises InputError."""
        rows = self._database.rows("SELECT * FROM alert WHERE id = ?", id_)
        if not rows:
            raise InputError(f"there is no alert '{id_}'")
        return _alert(rows[0])

    def newest(self, limit: int) -> list[Alert]:
        """Return the newest alerts, newest first."""
        return [_alert(row) for row in self._database.rows("SELECT * FROM alert ORDER BY at DESC LIMIT ?", limit)]

    def unacknowledged(self, limit: int) -> list[Alert]:
        """Return the newest urgent alerts that nobody has acknowledged, newest first."""
        query = f"SELECT * FROM alert WHERE {_UNACKNOWLEDGED} ORDER BY at DESC LIMIT ?"  # noqa: S608  only question marks
        return [_alert(row) for row in self._database.rows(query, *sorted(URGENT), limit)]

    def open(self) -> int:
        """Return the number of urgent alerts that nobody has acknowledged."""
        query = f"SELECT COUNT(*) FROM alert WHERE {_UNACKNOWLEDGED}"  # noqa: S608  only question marks
        return int(self._database.rows(query, *sorted(URGENT))[0][0])

    def deliveries(self, alert: str) -> list[Delivery]:
        """Return the ways of an alert."""
        query = "SELECT * FROM alert_delivery WHERE alert = ? ORDER BY rowid"
        return [_delivery(row) for row in self._database.rows(query, alert)]


def _deliver(tables: sqlite3.Connection, alert: str, route: str, due: datetime, after: str = "") -> None:
    tables.execute(
        "INSERT OR IGNORE INTO alert_delivery VALUES (?, ?, 'waiting', 0, ?, ?, 0, ?, '')",
        (alert, route, due.isoformat(), due.isoformat(), after),
    )


def _acknowledge(tables: sqlite3.Connection, id_: str, by: str, now: datetime) -> None:
    tables.execute(
        "UPDATE alert SET acknowledged = ?, by = ? WHERE id = ? AND acknowledged IS NULL", (now.isoformat(), by, id_)
    )
    tables.execute("UPDATE alert_delivery SET state = 'dropped' WHERE alert = ? AND state = 'waiting'", (id_,))


def _alert(row: sqlite3.Row) -> Alert:
    data = json.loads(row["data"])
    cause = Cause(**{**data["cause"], "kind": Kind(data["cause"]["kind"])})
    acknowledged = datetime.fromisoformat(row["acknowledged"]) if row["acknowledged"] else None
    return Alert(
        row["id"], cause, datetime.fromisoformat(row["at"]), datetime.fromisoformat(row["due"]), row["count"],
        tuple(data["steps"]), acknowledged, row["by"],
    )  # fmt: skip


def _delivery(row: sqlite3.Row) -> Delivery:
    return Delivery(
        row["alert"], row["route"], row["state"], row["tries"], datetime.fromisoformat(row["since"]),
        datetime.fromisoformat(row["due"]), bool(row["again"]) or row["state"] == "sending",
        row["after"], row["problem"],
    )  # fmt: skip
