"""What is to be published of the journals of runs, read from the record from the acknowledged positions on."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from bench.engine.control import OPERATOR
from bench.errors import InputError, StoreError
from bench.station.mqtt.messages import LARGEST_DATA, Alarm, Event, Finding, Message, Results
from bench.station.mqtt.positions import Position, Positions
from bench.station.mqtt.topics import Topics, bench_of_file
from bench.station.runs.catalogue import Catalogue, bench_file_of
from bench.store.reader import Event as Entry
from bench.store.runs import MANIFEST, RunSummary
from bench.store.tail import Begins, Tail, instant_at

AT_ONCE = 20
RESULTS = "results.json"
LARGEST_RESULTS = 64 * 1024 * 1024
_STILL = ("running", "interrupted")
_PASSING = ("interrupted", "damaged")  # a run that is being sealed is the latter for a moment
_ALARMS = frozenset({"problem", "stalled", "unit_dropped", "device_left_out", "unanswered", "step_failed", "power"})


class Batch(NamedTuple):
    """Messages of one run with their topics, in order, and the position when all of them are acknowledged."""

    run: str
    messages: list[tuple[str, Message]]
    position: Position


class Outbox:
    """Journals of all runs of a folder. `benches` are names of benches by bench file."""

    def __init__(self, runs: Path, benches: dict[str, str], positions: Positions, topics: Topics) -> None:
        self._catalogue, self._benches, self._positions, self._topics = Catalogue(runs), benches, positions, topics
        self._at_connection: dict[str, int] = {}

    def connected(self) -> None:
        """Take what is in the journals now as historical. At the first time, what has ended is not published."""
        waiting = {name: _last(self._catalogue.runs / name) for name in self._due()}
        if self._positions.is_new:
            ended = {
                name: Position(last, self._mark(name, run.state))
                for name, last in waiting.items()
                if (run := self._catalogue.run(name)).state not in _STILL
            }
            self._positions.begin(ended)
        self._at_connection = waiting

    def batches(self) -> Iterator[Batch]:
        """Yield the next messages of each run that has some, oldest run first."""
        for name in self._due():
            with suppress(InputError):  # it was removed
                if (batch := self._batch(name)) is not None:
                    yield batch

    def _due(self) -> list[str]:
        """Return the runs of which not everything was acknowledged."""
        return [name for name in reversed(self._catalogue.names()) if not self._is_complete(name)]

    def _is_complete(self, name: str) -> bool:
        state, _, stat = self._positions.of(name).mark.partition(" ")
        if not state or stat != self._stat(name):
            return False
        return state not in _PASSING or self._catalogue.run(name).state == state

    def _stat(self, name: str) -> str:
        try:
            found = (self._catalogue.runs / name / MANIFEST).stat()
        except OSError:
            return "none"
        return f"{found.st_mtime_ns}:{found.st_size}"

    def _mark(self, name: str, state: str) -> str:
        return f"{state} {self._stat(name)}"

    def _batch(self, name: str) -> Batch | None:
        before = self._positions.of(name)
        stat, run = self._stat(name), self._catalogue.run(name)  # first: what is written later changes them
        mark = "" if run.state == "running" else f"{run.state} {stat}"
        if run.state == "running" and not run.manifest:  # it is just beginning
            return None
        entries, begins = self._entries(run, before.seq)
        if entries is None:  # a run that has just begun has no record; that of one which has ended is damaged
            return Batch(name, [], before._replace(mark=mark)) if mark else None
        bench = bench_of_file(bench_file_of(run.manifest), self._benches)
        historical_to = self._at_connection.get(name, 0)
        messages: list[tuple[str, Message]] = []
        for entry in entries:
            event = _event(name, begins, entry, is_historical=entry.seq <= historical_to)
            messages.append((self._topics.of_bench(bench, "events"), event))
            if text := alarm(entry):
                messages.append((self._topics.of_bench(bench, "alarms"), _alarm(event, text)))
        last = entries[-1].seq if entries else before.seq
        if len(entries) == AT_ONCE:
            mark = ""
        elif run.state not in (*_STILL, "damaged"):
            results = results_of(run, is_historical=name in self._at_connection)
            messages.append((self._topics.of_bench(bench, "results"), results))
        return Batch(name, messages, Position(last, mark)) if messages or mark else None

    @staticmethod
    def _entries(run: RunSummary, after: int) -> tuple[list[Entry] | None, Begins]:
        try:
            with Tail(run.path) as tail:
                return tail.events(after, AT_ONCE), tail.begins()
        except (StoreError, ValueError):
            return None, None


def alarm(entry: Entry) -> str:
    """Return what has happened, if an entry needs a person; else ""."""
    data = entry.data
    match entry.kind:
        case "held" if data.get("by") != OPERATOR:
            return f"held by {data.get('by')}"
        case "made_safe" if data.get("unsafe"):
            return f"not safe: {data['unsafe']}"
        case "run_ended" if data.get("how") != "completed":
            return f"ended: {data.get('how')}"
        case kind if kind in _ALARMS:
            return str(data.get("text") or data.get("state") or kind.replace("_", " "))
        case _:
            return ""


def _event(run: str, begins: Begins, entry: Entry, *, is_historical: bool) -> Event:
    return Event(
        id=f"{run}:{entry.seq}", run=run, seq=entry.seq, kind=entry.kind, step=entry.step, at_s=entry.at_s,
        at=instant_at(begins, entry.at_s), data=_bounded(entry.data), is_historical=is_historical,
    )  # fmt: skip


def _alarm(event: Event, text: str) -> Alarm:
    return Alarm(
        id=event.id, run=event.run, seq=event.seq, kind=event.kind, text=text[:2000], step=event.step, at=event.at,
        is_historical=event.is_historical,
    )  # fmt: skip


def _bounded(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return data that a broker accepts; what is longer is in the record only."""
    try:
        length = len(json.dumps(data, allow_nan=False))
    except (ValueError, RecursionError):
        return {"unreadable": True}
    return data if length <= LARGEST_DATA else {"omitted_bytes": length}


def results_of(run: RunSummary, *, is_historical: bool) -> Results:
    """Return the end of a run: its outcome and, if they can be read, its findings."""
    manifest = run.manifest
    findings = list(_findings(run.path / RESULTS))
    shown = tuple(_fitting(findings))
    return Results(
        id=f"{run.id}:results", run=run.id, outcome=run.state, verdict=_text(manifest, "verdict"),
        title=str(manifest.get("title", "")), sequence=str(manifest.get("sequence", "")), units=run.units,
        ended=_text(manifest, "ended"), findings=shown,
        findings_omitted=len(findings) - len(shown), is_historical=is_historical,
    )  # fmt: skip


def _fitting(findings: list[Finding]) -> Iterator[Finding]:
    """Yield findings from the first one, as many as a broker accepts in one message."""
    left = LARGEST_DATA
    for each in findings:
        left -= len(each.payload())
        if left < 0:
            return
        yield each


def _text(manifest: Mapping[str, Any], key: str) -> str | None:
    return None if manifest.get(key) is None else str(manifest[key])


def _findings(file: Path) -> Iterator[Finding]:
    try:
        if file.stat().st_size > LARGEST_RESULTS:
            return
        found = json.loads(file.read_bytes())["findings"]
        for each in found:
            with suppress(ValidationError):
                yield Finding.model_validate(each)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return


def _last(run: Path) -> int:
    """Return the number of the last entry of a journal; 0 without a record."""
    try:
        with Tail(run) as tail:
            return tail.last_event()
    except StoreError:
        return 0
