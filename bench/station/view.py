"""What is seen of a station: models of the API, of pages and of MQTT."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, date, datetime, timedelta
from itertools import islice
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.station.daemon import Daemon
from bench.station.leases import Lease
from bench.station.queue.items import Item
from bench.station.runs.catalogue import ticket_of
from bench.station.runs.live import LiveRun
from bench.store.latch import latch
from bench.store.reader import Event
from bench.store.runs import RunSummary


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class EventView(_Model):
    """Entry of the journal of a run."""

    seq: int = Field(description="number in the journal, from 1")
    at_s: float = Field(description="bench time in s")
    at: datetime | None = Field(description="instant by the clock of the bench")
    kind: str
    step: str
    data: Mapping[str, Any]


class ReadingView(_Model):
    """Newest reading of a channel; `value` is null unless it is valid and not stale."""

    name: str
    quality: str = Field(description="valid, invalid or stale")
    value: float | None = None
    unit: str = ""
    age_s: float | None = None
    why: str = Field("", description="why it is invalid or stale")


class QuestionView(_Model):
    """Question to a person."""

    step: str
    text: str
    expected: str
    choices: list[str] = Field([], description="permitted answers; empty for a typed one")
    unit: str = Field("", description="unit of a typed answer; empty for a text")


class RunView(_Model):
    """Run in progress."""

    run: str = Field(description="name of the run directory")
    title: str
    sequence: str
    bench: str
    units: list[str] = Field(description="serial numbers")
    operator: str
    started: datetime | None
    item: str = Field(description="item of the queue; empty for a run started by hand")
    steps: list[str] = Field(description="ids of the steps in progress")
    done: int = Field(description="steps that have ended")
    total: int = Field(description="steps of the plan; 0 if it is unknown")
    now_s: float | None = Field(description="bench time in s")
    speed: float = Field(description="bench seconds per second")
    ends: datetime | None = Field(description="estimated end")
    held_by: list[str] = Field(description="why no further step begins; 'operator' for a person")
    questions: list[QuestionView]
    readings: list[ReadingView]
    problems: list[str]
    last_event: int


class ItemView(_Model):
    """Item of the queue with its estimated begin and end."""

    item: Item
    begins: datetime | None = None
    ends: datetime | None = None


class LeaseView(_Model):
    """Lease of a bench."""

    holder: str = Field(description="who works at the bench")
    note: str = Field(description="note of the holder")
    left_s: float = Field(description="time in s until it ends, unless it is renewed")

    @classmethod
    def of(cls, lease: Lease) -> LeaseView:
        """Return the view of a lease."""
        return cls(holder=lease.holder, note=lease.note, left_s=lease.left_s)


class BenchView(_Model):
    """Bench of the station."""

    name: str
    title: str
    lease: LeaseView | None = Field(None, description="who works at the bench; null for nobody in particular")
    stopped: str = Field(description="why no item begins; empty if items begin")
    running: list[RunView]
    waiting: list[ItemView]


class StationView(_Model):
    """The station at an instant."""

    title: str
    now: datetime
    benches: list[BenchView]
    problems: list[str] = Field(description="present errors of the station itself, such as a full disk")
    other_runs: list[RunView] = Field(description="runs in progress of bench files that the station does not have")
    banner: str = Field("", description="permanent warning; empty for none")


class RunInfo(_Model):
    """Run of the catalogue."""

    run: str
    state: str
    verdict: str | None
    title: str
    sequence: str
    bench: str
    units: list[str]
    operator: str
    order: str = ""
    started: str
    ended: str | None
    item: str
    latched: str


def event_view(begins: tuple[datetime, float] | None, event: Event) -> EventView:
    """Return the view of an entry of the journal; `begins` are instant and bench time in s of the begin of the run."""
    at = begins[0] + timedelta(seconds=event.at_s - begins[1]) if begins is not None else None
    return EventView(seq=event.seq, at_s=event.at_s, at=at, kind=event.kind, step=event.step, data=event.data)


def run_view(live: LiveRun) -> RunView:
    """Return the view of a run in progress."""
    manifest, status = live.run.manifest, live.status
    timeline = live.timeline or {}
    return RunView(
        run=live.run.id,
        title=str(manifest.get("title", "")),
        sequence=str(manifest.get("sequence", "")),
        bench=str(manifest.get("bench", "")),
        units=list(live.run.units),
        operator=str(manifest.get("operator", "")),
        started=_instant(manifest.get("started")),
        item=ticket_of(manifest),
        steps=list(live.state.under_way),
        done=live.state.done,
        total=len(timeline.get("steps", ())),
        now_s=status.get("now_s"),
        speed=live.speed,
        ends=live.ends(),
        held_by=live.holds,
        questions=[QuestionView.model_validate(each) for each in status.get("questions", ())],
        readings=[_reading_view(name, each) for name, each in status.get("readings", {}).items()],
        problems=list(live.state.problems),
        last_event=live.last,
    )


def _reading_view(name: str, reading: Mapping[str, Any]) -> ReadingView:
    known = {key: reading[key] for key in ("quality", "value", "unit", "age_s", "why") if key in reading}
    return ReadingView(name=name, **known)


def run_info(run: RunSummary) -> RunInfo:
    """Return the view of a run of the catalogue."""
    manifest = run.manifest
    found = latch(run)
    return RunInfo(
        run=run.id,
        state=run.state,
        verdict=manifest.get("verdict"),
        title=str(manifest.get("title", "")),
        sequence=str(manifest.get("sequence", "")),
        bench=str(manifest.get("bench", "")),
        units=list(run.units),
        operator=str(manifest.get("operator", "")),
        order=str(manifest.get("order") or ""),
        started=str(manifest.get("started", "")),
        ended=manifest.get("ended"),
        item=ticket_of(manifest),
        latched=found.why if found is not None else "",
    )


class RunFilter(_Model):
    """Filter of runs: a run must match every field that is not empty."""

    text: str = Field("", max_length=200, description="words in name, title, bench, units, operator, order or verdict")
    state: str = Field("", max_length=32)
    verdict: str = Field("", max_length=32)
    unit: str = Field("", max_length=64, description="serial number")
    bench: str = Field("", max_length=500, description="title of the bench")
    sequence: str = Field("", max_length=64)
    since: date | None = Field(None, description="first day (UTC) of the begin")
    until: date | None = Field(None, description="last day (UTC) of the begin")
    before: str = Field("", max_length=200, description="only runs older than this one, for the next page")

    def admits(self, info: RunInfo) -> bool:
        """Return True if a run matches."""
        equal = (
            (self.state, info.state), (self.verdict, info.verdict), (self.bench, info.bench),
            (self.sequence, info.sequence),
        )  # fmt: skip
        if any(wanted and wanted != given for wanted, given in equal):
            return False
        if (self.unit and self.unit not in info.units) or (self.before and info.run >= self.before):
            return False
        return self._is_of_these_days(info) and self._has_words(info)

    def _is_of_these_days(self, info: RunInfo) -> bool:
        begun = _instant(info.started)
        if self.since is None and self.until is None:
            return True
        if begun is None:
            return False
        day = begun.astimezone(UTC).date()
        return (self.since is None or day >= self.since) and (self.until is None or day <= self.until)

    def _has_words(self, info: RunInfo) -> bool:
        parts = (info.run, info.title, info.sequence, info.bench, info.operator, info.order, info.verdict or "")
        within = " ".join([*parts, *info.units]).lower()
        return all(word in within for word in self.text.lower().split())


def found_runs(runs: Iterable[RunSummary], wanted: RunFilter, limit: int) -> list[RunInfo]:
    """Return the first runs that a filter admits."""
    return list(islice((info for info in map(run_info, runs) if wanted.admits(info)), limit))


def item_views(daemon: Daemon, items: list[Item]) -> list[ItemView]:
    """Return items with their estimated instants."""
    expected = daemon.expected()
    return [
        ItemView(item=each, begins=when.begins if when else None, ends=when.ends if when else None)
        for each in items
        for when in [expected.get(each.id)]
    ]


def station_view(daemon: Daemon, now: datetime, banner: str = "") -> StationView:
    """Return the view of a station, with a permanent warning or none."""
    runs = [run_view(each) for each in daemon.live.runs.values()]
    waiting = item_views(daemon, daemon.queue.waiting())
    benches = [
        BenchView(
            name=name,
            title=title,
            lease=LeaseView.of(lease) if (lease := daemon.leases.of(name)) is not None else None,
            stopped=daemon.queue.stopped(name),
            running=[run for run in runs if daemon.bench_of(run.run) == name],
            waiting=[each for each in waiting if each.item.submission.bench == name],
        )
        for name, title in daemon.settings.titles.items()
    ]
    others = [run for run in runs if daemon.bench_of(run.run) is None]
    return StationView(
        title=daemon.settings.title,
        now=now,
        benches=benches,
        problems=daemon.problems(),
        other_runs=others,
        banner=banner,
    )


def _instant(text: Any) -> datetime | None:
    try:
        return datetime.fromisoformat(str(text))
    except ValueError:
        return None
