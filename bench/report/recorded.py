"""What a run has recorded, a piece at a time, and what its columns are called in files for other programs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bench.analysis.acquired import Acquisition, Counts
from bench.report.rundata import acquisitions
from bench.report.stored import StoredRun
from bench.store.reader import Event, Series


@dataclass(frozen=True)
class Column:
    """A column of a table: its unit, empty for what has none, and what it holds."""

    unit: str
    meaning: str


READINGS: Mapping[str, Column] = {
    "name": Column("", "named reading, or DEVICE.CHANNEL"),
    "unit": Column("", "unit of the value"),
    "t_s": Column("s", "bench time"),
    "value": Column("", "as it was read"),
}
LATCHES: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "channel": Column("", "channel of the counter"),
    "sequence": Column("", "number of the latch, unwrapped: a step above 1 is a gap"),
    "tick": Column("tick", "clock of the counter, wraps"),
    "positive": Column("pulse", "cumulative count of positive pulses, wraps"),
    "negative": Column("pulse", "cumulative count of negative pulses, wraps"),
}
COUNTERS = tuple(LATCHES)[2:]
JOURNAL: Mapping[str, Column] = {
    "seq": Column("", "number of the event"),
    "t_s": Column("s", "bench time"),
    "kind": Column("", "what happened"),
    "step": Column("", "during which step of the run"),
    "data": Column("", "what else is known of it, as JSON"),
}


def readings(run: StoredRun) -> Iterator[Series]:
    """Every channel that was read, one after the other."""
    return map(run.reader.series, run.reader.channels())


def latches(run: StoredRun) -> Iterator[tuple[Acquisition, str, Counts]]:
    """Every acquisition and channel, one after the other: raw counters, as they were on the wire; StoreError."""
    labels = dict.fromkeys(event.data.get("label") for event in run.reader.events("step_ended"))
    for label in filter(None, labels):
        for acquisition in acquisitions(run.reader, run.bench, (), label):
            for channel, counts in acquisition.counts.items():
                yield acquisition, channel, counts


def journal(run: StoredRun) -> Iterator[tuple[Event, str]]:
    """Every event, and its data as JSON."""
    return ((event, json.dumps(event.data, ensure_ascii=False)) for event in run.reader.events())
