"""What was received of all stations, in bounded memory: the newest of each message, and when it came."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import TypeVar

from bench.overview.facts import Facts, facts_of, name_of
from bench.overview.received import (
    KEPT,
    Alarm,
    Questions,
    Reading,
    Result,
    State,
    alarm_of,
    questions_of,
    result_of,
    state_of,
)

MOST_STATIONS, MOST_BENCHES = 100, 40  # benches of one station
MOST_TEMPERATURES = 4
LONGEST_LEVEL = 160
VALUE, SET_POINT = ".process_value", ".set_point"  # of a chamber
NOT_BENCHES = ("commands", "replies")
STATUS = ("online", "offline")
OF_BROKER = timedelta(seconds=2)  # between the last wills that a broker publishes when it ends, and its end
NEW = timedelta(seconds=10)  # begin of a subscription, in which the broker sends what it has retained
Entry = TypeVar("Entry", Alarm, Result)


@dataclass(slots=True)
class BenchSeen:
    """Bench as far as it was received; the rounds are the subscriptions that brought its state and its questions."""

    name: str
    state: State | None = None
    state_round: int = 0
    asked: Questions | None = None
    asked_round: int = 0
    readings: dict[str, Reading] = field(default_factory=dict)
    alarms: deque[Alarm] = field(default_factory=lambda: deque(maxlen=KEPT))
    results: deque[Result] = field(default_factory=lambda: deque(maxlen=KEPT))

    @property
    def is_empty(self) -> bool:
        """True if nothing is known of it."""
        return self.state is None and self.asked is None and not self.alarms and not self.results

    def take(self, kind: str, facts: Facts, now: datetime, number: int) -> None:
        """Take a message of a kind, in the subscription of a number."""
        match kind:
            case "state":
                self.state, self.state_round = state_of(facts, now), number
            case "questions":
                self.asked, self.asked_round = questions_of(facts, self.asked, now), number
            case "alarms":
                _add(self.alarms, alarm_of(facts, now))
            case _:
                _add(self.results, result_of(facts, now))

    def clear(self, kind: str) -> None:
        """Forget what was retained."""
        if kind == "state":
            self.state = None
        elif kind == "questions":
            self.asked = None

    def drop_older(self, number: int) -> None:
        """Forget what a subscription has not brought again."""
        if self.state_round < number:
            self.state = None
        if self.asked_round < number:
            self.asked = None


@dataclass(slots=True)
class StationSeen:
    """Station as far as it was received.

    `heard` is when it last sent something, None for one of which only retained messages are known; `died` is when its
    last will came. `clock_off` is its clock minus ours. `has_ended` is True if it has said that it ends. `connection`
    is the number of its connection.
    """

    name: str
    first: datetime
    benches: dict[str, BenchSeen] = field(default_factory=dict)
    status: str = ""
    status_round: int = 0
    has_ended: bool = False
    connection: int = -1
    title: str = ""
    version: str = ""
    computer: str = ""
    at: datetime | None = None
    heard: datetime | None = None
    died: datetime | None = None
    clock_off: timedelta | None = None
    has_unread: bool = False

    def take(self, facts: Facts, now: datetime, *, retained: bool, is_new: bool = False) -> None:
        """Take a status. The will of an older connection says nothing.

        Neither does, at the begin of a new subscription (`is_new`), that of a station that was there before the broker
        went: it may come back as well, and is lost when it is silent for long enough.
        """
        status, connection, at = facts.text("status", 20), facts.whole("bd_seq"), facts.instant("at", now)
        is_of_older = status == "offline" and self.status == "online" and connection != self.connection
        was_there = status == "offline" and self.status == "online" and at is None
        if (is_of_older and not retained) or (retained and is_new and was_there):
            return
        self.died = now if was_there and not retained else None
        self.status, self.has_ended = status, status == "offline" and at is not None
        self.at = at or self.at
        self.title, self.version = facts.text("title", 100) or self.title, facts.text("version", 40) or self.version
        self.computer = facts.text("computer", 100) or self.computer
        if status == "online":
            self.connection = connection
        if not retained and (status == "online" or at is not None):
            self.heard = now
            self.clock_off = at - now if at is not None else None

    def prune(self) -> None:
        """Forget benches of which nothing is known any more."""
        self.benches = {level: bench for level, bench in self.benches.items() if not bench.is_empty}


class Overview:
    """All stations of a broker by their names in topics. `refused` counts stations and benches beyond what is kept."""

    def __init__(self) -> None:
        self.stations: dict[str, StationSeen] = {}
        self.refused = 0
        self.connected: datetime | None = None  # since when; None while the broker is away
        self._round = 0

    def subscribed(self, now: datetime, *, again: bool = False) -> None:
        """Begin with what a new subscription brings; with `again`, the connection is that of the one before."""
        self._round += 1
        for station in self.stations.values():
            station.has_unread = False
        if not again or self.connected is None:
            self.connected = now

    def disconnected(self, now: datetime) -> None:
        """Keep what was received last; nothing more comes.

        A broker that ends publishes the last wills of all stations before: they say nothing of a station.
        """
        self.connected = None
        for station in self.stations.values():
            if station.died is not None and now - station.died < OF_BROKER:
                station.status, station.died = "online", None

    def settled(self) -> None:
        """Drop what the subscription has not brought again: it was removed from the broker meanwhile."""
        for station in list(self.stations.values()):
            for bench in station.benches.values():
                bench.drop_older(self._round)
            if station.status_round < self._round:
                station.status = ""
            self._prune(station)

    def take(self, topic: str, payload: bytes, now: datetime, *, retained: bool = False) -> None:
        """Take a message; one that cannot be read is noted at its station."""
        levels = topic.split("/")
        if levels[0] != "bench" or any(not 0 < len(each) <= LONGEST_LEVEL for each in levels):
            return
        match levels:
            case [_, name, "status"]:
                self._status(name, payload, now, retained=retained)
            case [_, name, bench, ("state" | "questions" | "alarms" | "results") as kind] if bench not in NOT_BENCHES:
                if payload:
                    self._of_bench(name, bench, kind, payload, now, retained=retained)
                else:
                    self._clear(name, bench, kind, now)
            case [_, name, bench, "readings", channel] if channel.endswith((VALUE, SET_POINT)):
                self._reading(name, bench, channel, payload, now)

    def _of_bench(self, name: str, level: str, kind: str, payload: bytes, now: datetime, *, retained: bool) -> None:
        facts = self._facts(name, payload)
        if facts is None or (station := self._station(name, now)) is None:
            return
        if (bench := self._bench(station, level)) is None:
            return
        bench.take(kind, facts, now, self._round)
        station.heard = station.heard if retained else now
        station.has_unread = station.has_unread or bool(facts.misfits)
        self._prune(station)  # questions without a question

    def _clear(self, name: str, level: str, kind: str, now: datetime) -> None:
        station = self.stations.get(name)
        if station is None or level not in station.benches:
            return
        station.benches[level].clear(kind)
        station.heard = now
        self._prune(station)

    def _status(self, name: str, payload: bytes, now: datetime, *, retained: bool) -> None:
        if not payload:
            if (known := self.stations.get(name)) is not None:
                known.status = ""
                self._prune(known)
            return
        facts = self._facts(name, payload)
        if facts is None or (status := facts.text("status", 20)) not in STATUS:
            return
        if (station := self._station(name, now, is_online=status == "online")) is not None:
            is_new = self.connected is not None and now - self.connected < NEW
            station.take(facts, now, retained=retained, is_new=is_new)
            station.status_round = self._round
            station.has_unread = station.has_unread or bool(facts.misfits)

    def _reading(self, name: str, level: str, channel: str, payload: bytes, now: datetime) -> None:
        """Take a reading of a chamber of a bench that is known."""
        station = self.stations.get(name)
        bench = station.benches.get(level) if station is not None else None
        if station is None or bench is None:
            return
        is_kept = channel in bench.readings or len(bench.readings) < 2 * MOST_TEMPERATURES
        if is_kept and (facts := self._facts(name, payload)) is not None:
            station.heard = now
            bench.readings[channel] = Reading(now, facts.number("value"), facts.text("unit", 10))

    def _facts(self, name: str, payload: bytes) -> Facts | None:
        """Return the facts of a message; None if it cannot be read, which a station that is known is marked with."""
        try:
            return facts_of(payload)
        except ValueError:
            if name in self.stations:
                self.stations[name].has_unread = True
            return None

    def _station(self, name: str, now: datetime, *, is_online: bool = False) -> StationSeen | None:
        """Return a station; a new one is kept if there is room, or in place of one that is not online."""
        found = self.stations.get(name)
        if found is not None:
            return found
        if len(self.stations) >= MOST_STATIONS:
            self.refused += 1
            victims = [each for each in self.stations.values() if each.status != "online"] if is_online else []
            if not victims:
                return None
            del self.stations[min(victims, key=lambda each: each.heard or each.first).name]
        self.stations[name] = found = StationSeen(name, now)
        return found

    def _bench(self, station: StationSeen, level: str) -> BenchSeen | None:
        found = station.benches.get(level)
        if found is None and len(station.benches) >= MOST_BENCHES:
            self.refused += 1
            return None
        if found is None:
            station.benches[level] = found = BenchSeen(name_of(level))
        return found

    def _prune(self, station: StationSeen) -> None:
        station.prune()
        if not station.benches and not station.status:
            self.stations.pop(station.name, None)


def _add(entries: deque[Entry], entry: Entry) -> None:
    """Add an entry as the newest; one with its `id` is replaced in its place."""
    for place, each in enumerate(entries):
        if entry.id and each.id == entry.id:
            entries[place] = entry._replace(came=each.came)
            return
    entries.append(entry)


def benches_of(overview: Overview) -> Iterator[tuple[StationSeen, str, BenchSeen]]:
    """Yield all benches, each with its station and its level in topics."""
    for station in overview.stations.values():
        for level, bench in station.benches.items():
            yield station, level, bench
