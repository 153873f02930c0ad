"""What a run has recorded, a piece at a time, and what its columns are called in files for other programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from bench.analysis.acquired import Acquisition
from bench.analysis.missed import EVENT, gap_columns
from bench.report.rundata import acquisitions
from bench.report.stored import StoredRun
from bench.store.reader import Event, Series
from drivers.can_telemetry.description import TelemetryOptions


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
POSITIONS: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "device": Column("", "what drives the axis of the encoder"),
    "sequence": Column("", "number of the latch, or of the sample, that it belongs to"),
    "tick": Column("tick", "clock of what latched it, wraps"),
    "position": Column("count", "counts of the encoder, wrap"),
}
SAMPLES: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "channel": Column("", "channel of the telemetry"),
    "sequence": Column("", "number of the sample, unwrapped: a step above 1 is a gap"),
    "tick": Column("tick", "clock of the unit, wraps"),
    "t_s": Column("s", "bench time of its arrival"),
    "value": Column("", "code, or what it is decoded to"),
}
VOLTAGES: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "voltmeter": Column("", "what read it"),
    "t_s": Column("s", "bench time of the middle of the reading"),
    "value": Column("V", "as it was read"),
}
CURRENTS: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "ammeter": Column("", "what read it"),
    "t_s": Column("s", "bench time of the middle of the reading"),
    "value": Column("A", "as it was read"),
}
GAPS: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "channel": Column("", "DEVICE.CHANNEL"),
    "first": Column("", "number of the first latch or sample of a row that did not come"),
    "last": Column("", "number of the last of them"),
    "from_s": Column("s", "bench time at which the one before arrived"),
    "to_s": Column("s", "bench time at which the one after arrived"),
    "device_s": Column("s", "time between these by the clock in the frames, less its whole rounds"),
}
JOURNAL: Mapping[str, Column] = {
    "seq": Column("", "number of the event"),
    "t_s": Column("s", "bench time"),
    "kind": Column("", "what happened"),
    "step": Column("", "during which step of the run"),
    "data": Column("", "what else is known of it, as JSON"),
}
WHOLE_NUMBERS = ("seq", "sequence", "tick", "positive", "negative", "position", "first", "last")
TIMES = ("t_s", "from_s", "to_s", "device_s")
Part = tuple[Mapping[str, str], Mapping[str, NDArray[Any]]]
"""Words that are alike for some rows, and these rows by their columns."""


@dataclass(frozen=True)
class Acquired:
    """A table of what was acquired: its columns, and the rows of an acquisition."""

    columns: Mapping[str, Column]
    rows: Callable[[Acquisition], Iterator[Part]]

    def parts(self, run: StoredRun) -> Iterator[Part]:
        """Every acquisition, one after the other, as it was on the wire; StoreError."""
        labels = dict.fromkeys(event.data.get("label") for event in run.reader.events("step_ended"))
        for label in filter(None, labels):
            for acquisition in acquisitions(run.reader, run.bench, (), label):
                yield from self.rows(acquisition)


def readings(run: StoredRun) -> Iterator[Series]:
    """Every channel that was read, one after the other."""
    return map(run.reader.series, run.reader.channels())


def acquired(run: StoredRun) -> dict[str, Acquired]:
    """The tables of what a run acquired: counters always, what else its bench measures with, gaps where it had some."""
    options = [entry.options for entry in run.bench.devices.values()]
    also = {
        "samples": any(isinstance(each, TelemetryOptions) for each in options),
        "positions": any(getattr(each, "positions", {}) for each in options),
        "voltages": bool(run.bench.with_capability("voltmeter")),
        "currents": bool(run.bench.with_capability("ammeter")),
        "gaps": any(True for _ in run.reader.events(EVENT)),
    }
    return {name: table for name, table in ACQUIRED.items() if also.get(name, True)}


def _latches(acquisition: Acquisition) -> Iterator[Part]:
    for channel, counts in acquisition.counts.items():
        yield _part(LATCHES, (acquisition.step, channel), counts)


def _positions(acquisition: Acquisition) -> Iterator[Part]:
    for device, read in acquisition.positions.items():
        yield _part(POSITIONS, (acquisition.step, device), read)


def _samples(acquisition: Acquisition) -> Iterator[Part]:
    for channel, codes in acquisition.codes.items():
        yield _part(SAMPLES, (acquisition.step, channel), codes, t_s="host_s", value="values")


def _gaps(acquisition: Acquisition) -> Iterator[Part]:
    for (device, channel), missed in acquisition.missed.items():
        found = acquisition.codes[channel] if missed.what == "samples" else acquisition.counts[channel]
        yield {"step": acquisition.step, "channel": f"{device}.{channel}"}, gap_columns(found)


def _voltages(acquisition: Acquisition) -> Iterator[Part]:
    for meter, read in acquisition.voltages.items():
        yield _part(VOLTAGES, (acquisition.step, meter), read, t_s="at_s", value="values_v")


def _currents(acquisition: Acquisition) -> Iterator[Part]:
    for meter, read in acquisition.currents.items():
        yield _part(CURRENTS, (acquisition.step, meter), read, t_s="at_s", value="values_a")


def _part(columns: Mapping[str, Column], words: tuple[str, str], of: object, **kept_as: str) -> Part:
    """The first two columns are the words, the others are kept under their names, or under another."""
    names = tuple(columns)
    return dict(zip(names[:2], words, strict=True)), {name: getattr(of, kept_as.get(name, name)) for name in names[2:]}


ACQUIRED: Mapping[str, Acquired] = {
    "acquisitions": Acquired(LATCHES, _latches),
    "samples": Acquired(SAMPLES, _samples),
    "positions": Acquired(POSITIONS, _positions),
    "voltages": Acquired(VOLTAGES, _voltages),
    "currents": Acquired(CURRENTS, _currents),
    "gaps": Acquired(GAPS, _gaps),
}


def journal(run: StoredRun) -> Iterator[tuple[Event, str]]:
    """Every event, and its data as JSON."""
    return ((event, json.dumps(event.data, ensure_ascii=False)) for event in run.reader.events())
