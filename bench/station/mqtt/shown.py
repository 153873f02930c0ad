"""What is shown of a station at an instant: its retained messages and newest readings, by topic."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import NamedTuple

from bench.clock import Stopwatch
from bench.station.mqtt.home_assistant import announcement
from bench.station.mqtt.messages import Question, Questions, Reading, State
from bench.station.mqtt.settings import MqttSettings
from bench.station.mqtt.topics import Topics
from bench.station.view import BenchView, ReadingView, RunView, StationView
from bench.store.tail import Begins, instant_at

ENDS_MOVED = timedelta(seconds=30)


class Shown(NamedTuple):
    """Messages by topic; a retained one that is empty removes the one before."""

    retained: dict[str, str]
    readings: dict[str, str]


class Show:
    """Messages of one view of the station after the other."""

    def __init__(self, settings: MqttSettings, version: str) -> None:
        self._settings, self._version, self._topics = settings, version, Topics(settings.station)
        self._ends: dict[str, datetime] = {}
        self._sent: dict[str, tuple[Stopwatch, str]] = {}
        self._channels: dict[str, dict[str, str]] = {}

    def of(self, view: StationView, begun: Mapping[str, Begins]) -> Shown:
        """Return the messages of a view; `begun` are the begins of runs. Of several runs of a bench the last counts."""
        shown = Shown({}, {})
        for bench in view.benches:
            run = max(bench.running, key=lambda each: each.run, default=None)
            shown.retained[self._topics.of_bench(bench.name, "state")] = self._state(bench, run).payload()
            questions = _questions(run).payload() if run is not None and run.questions else ""
            shown.retained[self._topics.of_bench(bench.name, "questions")] = questions
            if run is not None:
                self._read(bench.name, run, begun.get(run.run), shown.readings)
            if self._settings.home_assistant:
                topic, payload = announcement(bench, self._channels.get(bench.name, {}), self._topics, self._version)
                shown.retained[topic] = payload
        return shown

    def _state(self, bench: BenchView, run: RunView | None) -> State:
        common = {"title": bench.title, "stopped": bench.stopped, "waiting": len(bench.waiting)}
        if run is None:
            self._ends.pop(bench.name, None)
            return State.model_validate(common)
        return State.model_validate({
            **common, "run": run.run, "sequence": run.sequence, "run_title": run.title, "units": run.units,
            "operator": run.operator, "item": run.item, "steps": run.steps, "sentence": getattr(run, "sentence", ""),
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
