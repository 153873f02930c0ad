"""Board: the cards of all benches as parts of a page, rendered once for all viewers who see the same."""

from __future__ import annotations

import platform
from collections.abc import Callable
from datetime import datetime
from typing import Any, NamedTuple

from bench.clock import Stopwatch, wall_utc
from bench.figures.languages import language
from bench.overview.broker import Subscription
from bench.overview.cards import Card, Kind, cards_of, counts
from bench.overview.fold import MOST_BENCHES, MOST_STATIONS, Overview
from bench.overview.words import GROUPS, Words, chamber, outcome, passed_min, temperature
from bench.web.pages.render import rendered
from bench.web.shown import clock_time

MOST_SHOWN = 300
FRESH_S = 0.9
VIEWERS_KEPT = 64


class Viewer(NamedTuple):
    """What differs between viewers. `is_here` is True at this computer, `bench` is the key of a single one."""

    language: str
    station: str = ""
    hides_gone: bool = False
    is_here: bool = False
    bench: str = ""


class Shown(NamedTuple):
    """Words of a card, its parts, and the address of its page at its station that this viewer can reach."""

    words: Words
    url: str
    main: str
    newest: str


class Group(NamedTuple):
    """Cards of a kind under their title."""

    kind: Kind
    title: str
    cards: list[Shown]


class Parts(NamedTuple):
    """Parts of a page by name. `board` holds all cards; it is sent again only when `order` changes."""

    order: tuple[object, ...]
    board: str
    status: str
    cards: dict[str, str]


class Boards:
    """Boards of all viewers."""

    def __init__(
        self, overview: Overview, subscription: Subscription, zone: str, now: Callable[[], datetime] = wall_utc
    ) -> None:
        self.overview, self.subscription, self.zone, self._now = overview, subscription, zone, now
        self._cards: tuple[Stopwatch, list[Card]] | None = None
        self._parts: dict[Viewer, tuple[Stopwatch, Parts]] = {}
        self._rendered: dict[tuple[str, str, bool], tuple[Card, int, Shown]] = {}

    def cards(self) -> list[Card]:
        """Return all cards, at most a second old."""
        if self._cards is None or self._cards[0].elapsed_s() > FRESH_S:
            self._cards = Stopwatch(), cards_of(self.overview, self._now())
            kept = {card.key for card in self._cards[1]}
            self._rendered = {key: each for key, each in self._rendered.items() if key[0] in kept}
        return self._cards[1]

    def card(self, key: str) -> Card | None:
        """Return a card by its key; None if there is none."""
        return next((card for card in self.cards() if card.key == key), None)

    def stations(self) -> list[tuple[str, str]]:
        """Return names and titles of all stations."""
        found = {card.station: card.station_title for card in self.cards()}
        return sorted(found.items(), key=lambda each: (each[1].lower(), each[0]))

    def parts(self, viewer: Viewer) -> Parts:
        """Return the parts of the page of a viewer, at most a second old."""
        known = self._parts.get(viewer)
        if known is not None and known[0].elapsed_s() <= FRESH_S:
            return known[1]
        with language(viewer.language):
            found = self._made(viewer)
        self._parts.pop(viewer, None)
        while len(self._parts) >= VIEWERS_KEPT:
            self._parts.pop(next(iter(self._parts)))
        self._parts[viewer] = Stopwatch(), found
        return found

    def _made(self, viewer: Viewer) -> Parts:
        everything = [card for card in self.cards() if viewer.station in ("", card.station)]
        cards = [card for card in everything if card.kind is not Kind.GONE or not viewer.hides_gone]
        if viewer.bench:
            cards = [card for card in everything if card.key == viewer.bench]
        shown = [self._shown(card, viewer) for card in cards[:MOST_SHOWN]]
        names = {"groups": _groups(shown), "left_out": max(0, len(cards) - MOST_SHOWN), "viewer": viewer}
        parts: dict[str, str] = {}
        for each in shown:
            parts |= {f"m-{each.words.card.key}": each.main, f"n-{each.words.card.key}": each.newest}
        order = tuple((card.kind, card.key, card.title, card.station_title) for card in cards[:MOST_SHOWN])
        board = rendered("overview/part_board.html.j2", **names)
        return Parts((*order, len(cards)), board, self._status(counts(everything), len(everything)), parts)

    def _status(self, number: dict[Kind, int], total: int) -> str:
        broker = self.subscription
        away = None if not broker.problem else clock_time(broker.since, self.zone, self._now())
        return rendered(
            "overview/part_status.html.j2", number=number, total=total, kinds=Kind, broker=broker, away=away,
            refused=self.overview.refused, limits=(MOST_STATIONS, MOST_BENCHES),
        )  # fmt: skip

    def _shown(self, card: Card, viewer: Viewer) -> Shown:
        """Return a card as it is shown, rendered again when it or the minute has changed."""
        now = self._now()
        minute, key = int(now.timestamp() // 60), (card.key, viewer.language, viewer.is_here)
        known = self._rendered.get(key)
        if known is not None and known[:2] == (card, minute):
            return known[2]
        words, url = Words(card, now, self.zone), url_for(card, viewer)
        names: dict[str, Any] = {
            "words": words, "card": card, "url": url, "kinds": Kind, "temperature": temperature, "chamber": chamber,
            "outcome": outcome, "passed_min": passed_min,
        }  # fmt: skip
        main, newest = (rendered(f"overview/part_{name}.html.j2", **names) for name in ("main", "newest"))
        found = Shown(words, url, main, newest)
        self._rendered[key] = card, minute, found
        return found


def url_for(card: Card, viewer: Viewer) -> str:
    """Return the page of a bench at its station; "" if the viewer cannot reach it."""
    if card.is_here and not (viewer.is_here and card.computer == platform.node()):
        return ""
    return card.url


def _groups(shown: list[Shown]) -> list[Group]:
    groups: dict[str, Group] = {}
    for each in shown:
        kind = each.words.card.kind
        groups.setdefault(GROUPS[kind], Group(kind, GROUPS[kind], [])).cards.append(each)
    return list(groups.values())
