"""Cards: what is shown of each bench, in the order in which a person looks at them."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from datetime import datetime, timedelta
from enum import IntEnum
from typing import NamedTuple
from urllib.parse import urlsplit

from bench.client.address import LOOPBACK
from bench.engine.control import OPERATOR
from bench.overview.facts import name_of
from bench.overview.fold import (
    MOST_TEMPERATURES,
    SET_POINT,
    VALUE,
    BenchSeen,
    Overview,
    StationSeen,
    benches_of,
)
from bench.overview.received import Alarm, Question, Result, State

SILENT = timedelta(seconds=180)  # three times what a station lets pass between two messages
GONE = timedelta(hours=24)
CLOCK_OFF = timedelta(seconds=60)
READING_OLD = timedelta(seconds=30)
ENDS_TOGETHER = timedelta(minutes=10)  # within it, benches keep their places


class Kind(IntEnum):
    """Kind of a card, in the order in which they are shown."""

    ASKS = 0
    PAUSED = 1
    ALARM = 2
    LOST = 3
    RUNNING = 4
    IDLE = 5
    GONE = 6


class Temperature(NamedTuple):
    """Newest temperature of a chamber in °C, and its set point; `old_min` is its age in minutes, 0 for a new one."""

    name: str
    value: float | None
    set_point: float | None
    old_min: int


class Card(NamedTuple):
    """What is shown of a bench. Instants are by our clock.

    `done` is between 0 and 1, None if unknown. `heard` is the last sign of a station that is lost. `clock_off_min` is
    its clock minus ours, `before` is the kind that it had when its station was last heard. `is_here` is True for a
    page that only the computer of the station reaches.
    """

    key: str
    kind: Kind
    before: Kind
    station: str
    level: str
    name: str
    title: str
    station_title: str
    zone: str
    run: str
    run_title: str
    units: tuple[str, ...]
    operator: str
    sentence: str
    sentences: tuple[tuple[str, str], ...]
    started: datetime | None
    ends: datetime | None
    done: float | None
    step: tuple[int, int]
    questions: tuple[Question, ...]
    since: datetime | None
    held_by: tuple[str, ...]
    problems: tuple[str, ...]
    stopped: str
    waiting: int
    temperatures: tuple[Temperature, ...]
    url: str
    is_here: bool
    heard: datetime | None
    silent_min: int | None
    has_ended: bool
    clock_off_min: int
    has_state: bool
    alarms: tuple[Alarm, ...]
    results: tuple[Result, ...]
    recorded: tuple[str, ...]
    computer: str
    version: str
    has_unread: bool

    @property
    def place(self) -> tuple[object, ...]:
        """Place in the order of all cards: by kind, those that run by their end."""
        first = self.since if self.kind in (Kind.ASKS, Kind.PAUSED) else None
        if self.kind is Kind.RUNNING:
            first = self.ends
        rounded = first.timestamp() // ENDS_TOGETHER.total_seconds() if first is not None else float("inf")
        was = self.before if self.kind is Kind.LOST else 0
        names = _natural(self.station_title), _natural(self.title)
        return (self.kind, was, rounded, *names, self.station, self.level)


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """Return a key by which "bench 9" comes before "bench 10"."""
    parts = re.findall(r"[0-9]{1,9}|[^0-9]+", name.lower())
    return [(each[0] in "0123456789", int(each) if each[0] in "0123456789" else 0, each) for each in parts]


def cards_of(overview: Overview, now: datetime) -> list[Card]:
    """Return the cards of all benches in their order."""
    titles = _titles(overview)
    cards = [
        _card(overview, station, level, bench, now)._replace(station_title=titles[station.name])
        for station, level, bench in benches_of(overview)
    ]
    return sorted(cards, key=lambda card: card.place)


def _titles(overview: Overview) -> dict[str, str]:
    """Return titles of stations by their names; those with the same title are told apart by their names."""
    number = Counter(station.title for station in overview.stations.values())
    found = {}
    for name, station in overview.stations.items():
        own = name_of(name)
        several = f"{station.title} ({own})" if number[station.title] > 1 else station.title
        found[name] = several if station.title else own
    return found


def last_sign(station: StationSeen, now: datetime) -> datetime | None:
    """Return when a station last sent something, by what is known: its own clock for one that was only retained."""
    if station.heard is not None:
        return station.heard
    states = [bench.state.at for bench in station.benches.values() if bench.state is not None]
    known = [each for each in (station.at, *states) if each is not None]
    return min(max(known), now) if known else None


def is_lost(overview: Overview, station: StationSeen, now: datetime) -> bool:
    """Return True for a station that is offline, or silent although the broker is there."""
    if station.status != "online":
        return station.status == "offline" or station.heard is None or _is_silent(overview, station, now)
    if station.heard is None and (sign := last_sign(station, now)) is not None and now - sign > GONE:
        return True  # a retained message is old, unless its clock is wrong, which its next message shows
    return _is_silent(overview, station, now)


def _is_silent(overview: Overview, station: StationSeen, now: datetime) -> bool:
    if overview.connected is None:
        return False
    return now - max(station.heard or station.first, overview.connected) > SILENT


def _card(overview: Overview, station: StationSeen, level: str, bench: BenchSeen, now: datetime) -> Card:
    state = bench.state
    off = station.clock_off if station.clock_off is not None and abs(station.clock_off) >= CLOCK_OFF else timedelta(0)
    sign, asked = last_sign(station, now), bench.asked
    before = _kind(state, asks=asked is not None)
    kind = before
    if is_lost(overview, station, now):
        kind = Kind.GONE if now - (sign or station.first) > GONE else Kind.LOST
    is_away = kind in (Kind.LOST, Kind.GONE)
    url = state.url if state is not None else ""
    started = _shifted(state.started, off) if state is not None else None
    ends = _shifted(state.ends, off) if state is not None else None
    since = None
    if asked is not None:
        since = _shifted(asked.at, off) or asked.came
    elif state is not None and before is Kind.PAUSED:
        since = _shifted(state.at, off) or state.came
    return Card(
        key=hashlib.sha256(f"{station.name}/{level}".encode()).hexdigest()[:16],
        kind=kind, before=before, station=station.name, level=level, name=bench.name,
        title=(state.title if state is not None else "") or bench.name,
        station_title="",
        zone=state.zone if state is not None else "",
        run=state.run if state is not None else "",
        run_title=(state.run_title or state.sequence or state.run) if state is not None else "",
        units=state.units if state is not None else (),
        operator=state.operator if state is not None else "",
        sentence=state.sentence if state is not None else "",
        sentences=tuple(state.sentences.items()) if state is not None else (),
        started=started, ends=ends, done=_done(state, started, ends, now),
        step=(min(state.done + 1, state.total), state.total) if state is not None else (0, 0),
        questions=asked.questions if asked is not None else (), since=since,
        held_by=tuple(each for each in state.held_by if each != OPERATOR) if state is not None else (),
        problems=state.problems[::-1] if state is not None else (),
        stopped=state.stopped if state is not None else "",
        waiting=state.waiting if state is not None else 0,
        temperatures=tuple(_temperatures(bench, now)) if state is not None and state.run else (),
        url=url, is_here=bool(url) and urlsplit(url).hostname in LOOPBACK,
        heard=sign if is_away else None,
        silent_min=int((now - sign).total_seconds() // 60) if is_away and sign is not None else None,
        has_ended=station.has_ended and station.status == "offline",
        clock_off_min=round(off.total_seconds() / 60), has_state=state is not None,
        alarms=tuple(bench.alarms)[::-1], results=tuple(bench.results)[::-1],
        recorded=tuple(dict.fromkeys(each for each in (state.recorded, state.title) if each)) if state is not None
        else (),
        computer=station.computer, version=station.version, has_unread=station.has_unread,
    )  # fmt: skip


def _kind(state: State | None, *, asks: bool) -> Kind:
    if asks:
        return Kind.ASKS
    if state is None:
        return Kind.IDLE
    if state.problems or state.stopped or set(state.held_by) - {OPERATOR}:
        return Kind.ALARM
    if state.held_by:
        return Kind.PAUSED
    return Kind.RUNNING if state.run else Kind.IDLE


def _shifted(instant: datetime | None, off: timedelta) -> datetime | None:
    """Return an instant by our clock."""
    return instant - off if instant is not None else None


def _done(state: State | None, started: datetime | None, ends: datetime | None, now: datetime) -> float | None:
    """Return how much of a run is done: by time, else by steps; in hundredths."""
    if state is None or not state.run:
        return None
    if started is not None and ends is not None and ends > started:
        return round(min(max((now - started) / (ends - started), 0.0), 1.0), 2)
    return round(min(state.done / state.total, 1.0), 2) if state.total else None


def _temperatures(bench: BenchSeen, now: datetime) -> list[Temperature]:
    found = []
    for channel, reading in sorted(bench.readings.items()):
        if not channel.endswith(VALUE) or reading.unit != "°C":
            continue
        name = channel.removesuffix(VALUE)
        wanted = bench.readings.get(f"{name}{SET_POINT}")
        old = now - reading.came
        old_min = max(1, int(old.total_seconds() // 60)) if old > READING_OLD else 0
        found.append(Temperature(name, reading.value, wanted.value if wanted is not None else None, old_min))
    return found[:MOST_TEMPERATURES]


def counts(cards: list[Card]) -> dict[Kind, int]:
    """Return how many cards there are of each kind."""
    return {kind: sum(card.kind is kind for card in cards) for kind in Kind}
