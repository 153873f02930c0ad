"""What is shown of a station at an instant: its retained messages and newest readings, by topic."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from typing import NamedTuple
from urllib.parse import quote

from bench.clock import Stopwatch
from bench.figures.languages import ENGLISH
from bench.station.mqtt.home_assistant import announcement
from bench.station.mqtt.messages import Question, Questions, Reading, State
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.topics import Topics
from bench.station.view import BenchView, ReadingView, RunView, StationView
from bench.store.tail import Begins, instant_at

ENDS_MOVED = timedelta(seconds=30)
STATE_AGAIN = timedelta(hours=1)


class Shown(NamedTuple):
    """Messages by topic; a retained one that is empty removes the one before."""

    retained: dict[str, str]
    readings: dict[str, str]


Words = Callable[[str], Mapping[str, str]]


class About(NamedTuple):
    """What does not change of a bench: its time zone, and its title in the records of runs."""

    zone: str = ""
    recorded: str = ""


def no_words(_: str) -> Mapping[str, str]:
    """Return no words for what a run does."""
    return {}


class Show:
    """Messages of one view of the station after the other; `about` is by the names of benches.

    `words` returns what a run does, by languages.
    """

    def __init__(
        self, settings: MqttSettings, version: str, about: Mapping[str, About] | None = None, words: Words = no_words
    ) -> None:
        self._settings, self._version, self._topics = settings, version, Topics(settings.station)
        self._about, self._words = about or {}, words
        self._ends: dict[str, datetime] = {}
        self._dates: dict[str, tuple[str, datetime]] = {}
        self._sent: dict[str, tuple[Stopwatch, str]] = {}
        self._channels: dict[str, dict[str, str]] = {}

    def of(self, view: StationView, begun: Mapping[str, Begins], address: str = "") -> Shown:
        """Return the messages of a view; `begun` are the begins of runs. Of several runs of a bench the last counts.

        `address` is the URL of the station; empty if it has none for others.
        """
        shown = Shown({}, {})
        for bench in view.benches:
            run = max(bench.running, key=lambda each: each.run, default=None)
            about = self._topics.of_bench(bench.name, "state"), self._topics.of_bench(bench.name, "questions")
            shown.retained[about[0]] = self._dated(about[0], self._state(bench, run, address), view.now, STATE_AGAIN)
            open_ones = _questions(run) if run is not None and run.questions else None
            shown.retained[about[1]] = self._dated(about[1], open_ones, view.now)
            if run is not None:
                self._read(bench.name, run, begun.get(run.run), shown.readings)
            if self._settings.home_assistant:
                topic, payload = announcement(bench, self._channels.get(bench.name, {}), self._topics, self._version)
                shown.retained[topic] = payload
        return shown

    def _dated(
        self, topic: str, message: State | Questions | None, now: datetime, again: timedelta = timedelta.max
    ) -> str:
        """Return a message with the instant since when it is as it is, or of `again` later; "" for none."""
        if message is None:
            self._dates.pop(topic, None)
            return ""
        same = message.payload()
        last = self._dates.get(topic)
        if last is None or last[0] != same or now - last[1] >= again:
            self._dates[topic] = last = same, now.replace(microsecond=0)
        return message.model_copy(update={"at": last[1]}).payload()

    def _state(self, bench: BenchView, run: RunView | None, address: str) -> State:
        about = self._about.get(bench.name, About())
        common = {
            "title": bench.title, "stopped": bench.stopped, "waiting": len(bench.waiting), "zone": about.zone,
            "bench": about.recorded, "url": f"{address}benches/{quote(bench.name, safe='')}" if address else "",
        }  # fmt: skip
        if run is None:
            self._ends.pop(bench.name, None)
            return State.model_validate(common)
        words = self._words(run.run)
        return State.model_validate({
            **common, "run": run.run, "sequence": run.sequence, "run_title": run.title, "units": run.units,
            "operator": run.operator, "item": run.item, "started": run.started, "steps": run.steps,
            "sentence": words.get(ENGLISH, ""),
            "sentences": {code: text for code, text in words.items() if code != ENGLISH},
            "done": run.done, "total": run.total, "ends": self._steady(bench.name, run.ends), "held_by": run.held_by,
            "problems": [text[:500] for text in run.problems[-20:]],
        })  # fmt: skip

    def _steady(self, bench: str, ends: datetime | None) -> datetime | None:
        """Return the end as sent last, unless it has moved."""
        if ends is None:
            return None
        last = self._ends.get(bench)
        if last is None or abs(ends - last) >= ENDS_MOVED:
            self._ends[bench] = last = ends.replace(microsecond=0)
        return last

    def _read(self, bench: str, run: RunView, begun: Begins, readings: dict[str, str]) -> None:
        """Add the readings that are due: new ones, of each channel not sooner than the settings say."""
        channels = self._channels.setdefault(bench, {})
        for each in run.readings:
            if each.unit or each.name not in channels:
                channels[each.name] = each.unit
            topic = self._topics.reading(bench, each.name)
            payload = _reading(run, begun, each).payload()
            sent = self._sent.get(topic)
            if sent is None or (sent[1] != payload and sent[0].elapsed_s() >= self._settings.readings_every):
                self._sent[topic] = Stopwatch(), payload
                readings[topic] = payload


def _questions(run: RunView) -> Questions:
    return Questions(run=run.run, questions=tuple(Question(**each.model_dump()) for each in run.questions))


def _reading(run: RunView, begun: Begins, reading: ReadingView) -> Reading:
    at_s = None
    if run.now_s is not None and reading.age_s is not None:
        at_s = round(run.now_s - reading.age_s, 3)
    return Reading(
        run=run.run, value=reading.value, unit=reading.unit, quality=reading.quality, why=reading.why, at_s=at_s,
        at=instant_at(begun, at_s),
    )  # fmt: skip
