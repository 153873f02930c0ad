"""Words of cards, in the current language."""

from __future__ import annotations

from datetime import datetime
from typing import NamedTuple
from zoneinfo import ZoneInfo

from markupsafe import Markup, escape

from bench.figures.languages import current, tr
from bench.figures.sayings import plain, said
from bench.figures.times_and_sizes import duration
from bench.overview.cards import Card, Kind, Temperature
from bench.overview.received import Result
from bench.web.shown import clock_time, name_in_words, number

NAMES = {
    Kind.ASKS: "Needs an answer",
    Kind.PAUSED: "Paused",
    Kind.ALARM: "Alarm",
    Kind.LOST: "Lost contact",
    Kind.RUNNING: "Running",
    Kind.IDLE: "Nothing runs",
    Kind.GONE: "Gone",
}
GROUPS = {
    Kind.ASKS: "Wait for a person",
    Kind.PAUSED: "Wait for a person",
    Kind.ALARM: "Need a look",
    Kind.LOST: "Lost contact",
    Kind.RUNNING: "Run",
    Kind.IDLE: "Idle",
    Kind.GONE: "Gone for more than a day",
}
MARKS = {Kind.ASKS: "?", Kind.PAUSED: "‖", Kind.ALARM: "▲", Kind.LOST: "△", Kind.GONE: "×"}


class Words(NamedTuple):
    """Words of one card; `now` is the present instant, and `zone` that of the page."""

    card: Card
    now: datetime
    zone: str

    @property
    def state(self) -> str:
        """State in a word or two."""
        return tr(NAMES[self.card.kind])

    @property
    def mark(self) -> str:
        """Sign before the state; empty for one that needs nothing."""
        return MARKS.get(self.card.kind, "")

    @property
    def sentence(self) -> Markup:
        """What the run does."""
        own = dict(self.card.sentences).get(current(), "")
        return escape(own) if own else said(self.card.sentence)

    @property
    def ends(self) -> str:
        """When the run ends."""
        if self.card.ends is None or not self.card.run:
            return ""
        form = "ends about {time}" if self.card.ends >= self.now else "was to end about {time}"
        return tr(form, time=self.at(self.card.ends))

    @property
    def heard(self) -> str:
        """When its station was heard last."""
        if self.card.heard is None or self.card.silent_min is None:
            return tr("not heard since this page was started")
        if self.card.has_ended:
            return tr("the station was ended at {time}", time=self.at(self.card.heard))
        if not self.card.silent_min:
            return tr("last heard less than a minute ago")
        if self.card.silent_min < 90:
            return tr("last heard {time} ago", time=passed_min(self.card.silent_min))
        return tr("last heard {time}", time=self.at(self.card.heard))

    @property
    def held(self) -> str:
        """Why no step begins, if that is no person; empty otherwise."""
        by = tr(", ").join(plain(each) for each in self.card.held_by)
        return tr("Held before the next step: {by}", by=by) if by else ""

    @property
    def since(self) -> str:
        """Since when it waits, and for how long."""
        if self.card.since is None:
            return ""
        minutes = max(0.0, (self.now - self.card.since).total_seconds()) // 60
        text = tr("since {time}", time=self.at(self.card.since))
        return tr("{since}, for {passed}", since=text, passed=passed_min(minutes)) if minutes else text

    @property
    def clock(self) -> str:
        """Warning of a clock that differs; empty if it is right."""
        minutes = self.card.clock_off_min
        if not minutes:
            return ""
        off = passed_min(abs(minutes))
        ahead = minutes > 0
        return tr("Its clock is {time} ahead of ours.", time=off) if ahead else tr(
            "Its clock is {time} behind ours.", time=off
        )  # fmt: skip

    @property
    def verdicts(self) -> str:
        """Verdicts of the last runs, the latest first."""
        return " · ".join(outcome(each) for each in self.card.results[:3])

    @property
    def percent(self) -> int | None:
        """How much of the run is done in per cent."""
        return round(100 * self.card.done) if self.card.done is not None else None

    def at(self, instant: datetime | None) -> str:
        """Return an instant by the clock of the bench, with its zone if that is not the one of the page."""
        if instant is None:
            return tr("unknown")
        zone = self.card.zone or self.zone
        there, here = (instant.astimezone(ZoneInfo(each)) for each in (zone, self.zone))
        text = clock_time(instant, zone, self.now)
        return text if there.utcoffset() == here.utcoffset() else f"{text} {there:%Z}"


def passed_min(minutes: float) -> str:
    """Return whole minutes in words."""
    return duration(60.0 * minutes) if minutes >= 2 else "1 min"


def outcome(result: Result) -> str:
    """Return the verdict of a run, else how it ended."""
    return tr(result.verdict or result.outcome or "unknown")


def temperature(found: Temperature) -> str:
    """Return a temperature with its set point."""
    shown = number(found.value, "°C", ".1f") if found.value is not None else tr("not read")
    if found.set_point is None:
        return shown
    return tr("{value}, set {target}", value=shown, target=number(found.set_point, "°C", ".1f"))


def chamber(name: str) -> str:
    """Return the name of a chamber in words."""
    return tr(name) if tr(name) != name else name_in_words(name)
