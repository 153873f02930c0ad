"""Recorded data of a run in parts, with their column descriptions in files for other programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from bench.metrology.acquisition import Acquisition
from bench.metrology.gaps import EVENT, gap_columns
from bench.reduce.acquisitions import acquisitions
from bench.reduce.stored_run import StoredRun
from drivers.can.sent_frames import Sampled


@dataclass(frozen=True)
class Column:
    """A column of a table: its unit, empty for none, and its content."""

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
    "tick_period_s": Column("s", "what one tick lasts"),
}
POSITIONS: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "device": Column("", "what drives the axis of the encoder"),
    "sequence": Column("", "number of the latch, or of the sample, that it belongs to"),
    "tick": Column("tick", "clock of what latched it, wraps"),
    "position": Column("count", "counts of the encoder, wrap"),
    "tick_period_s": Column("s", "what one tick lasts"),
    "resolution_deg": Column("°", "what one count is"),
}
SAMPLES: Mapping[str, Column] = {
    "step": Column("", "step of the run that acquired it"),
    "channel": Column("", "channel of the telemetry"),
    "unit": Column("", "unit of the value"),
    "sequence": Column("", "number of the sample, unwrapped: a step above 1 is a gap"),
    "tick": Column("tick", "clock of the unit, wraps"),
    "t_s": Column("s", "bench time of its arrival"),
    "value": Column("", "code, or what it is decoded to"),
    "tick_period_s": Column("s", "what one tick lasts"),
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
    "first": Column("", "number of the first lost latch or sample of a gap"),
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
FIXED = ("tick_period_s", "resolution_deg")
TIMES = ("t_s", "from_s", "to_s", "device_s")
JOURNAL_ROWS = 1 << 14  # of a part
Part = tuple[Mapping[str, str], Mapping[str, Any]]
"""Words constant for some rows, and these rows by their columns."""


@dataclass(frozen=True)
class Table:
    """A table of a run: its columns, and its data part by part; reading a part raises StoreError."""

    columns: Mapping[str, Column]
    parts: Callable[[], Iterator[Part]]


@dataclass(frozen=True)
class _Kind:
    """A kind of acquired data: its columns, the attribute of an acquisition, and columns with another name there."""

    columns: Mapping[str, Column]
    kept_in: str
    kept_as: Mapping[str, str] = field(default_factory=dict)


_ACQUIRED: Mapping[str, _Kind] = {
    "acquisitions": _Kind(LATCHES, "counts"),
    "samples": _Kind(SAMPLES, "codes", {"t_s": "host_s", "value": "values"}),
    "positions": _Kind(POSITIONS, "positions"),
    "voltages": _Kind(VOLTAGES, "voltages", {"t_s": "at_s", "value": "values_v"}),
    "currents": _Kind(CURRENTS, "currents", {"t_s": "at_s", "value": "values_a"}),
}


def tables(run: StoredRun) -> dict[str, Table]:
    """Tables of a run: readings, counters, other instruments of the bench, gaps if there are any, and the journal."""
    every = (output for entry in run.bench.devices.values() for output in entry.outputs.items())
    units = {name: output.unit for name, output in every if isinstance(output, Sampled)}
    there = {
        "samples": bool(units),
        "positions": any(entry.encoders for entry in run.bench.devices.values()),
        "voltages": bool(run.bench.with_capability("voltmeter")),
        "currents": bool(run.bench.with_capability("ammeter")),
    }
    kinds = {name: kind for name, kind in _ACQUIRED.items() if there.get(name, True)}
    found = {"readings": Table(READINGS, partial(_readings, run))}
    found |= {name: Table(kind.columns, partial(_acquired, run, kind, units)) for name, kind in kinds.items()}
    if any(True for _ in run.reader.events(EVENT)):
        found["gaps"] = Table(GAPS, partial(_gaps, run))
    return found | {"journal": Table(JOURNAL, partial(_journal, run))}


def _readings(run: StoredRun) -> Iterator[Part]:
    for series in map(run.reader.series, run.reader.channels()):
        yield {"name": series.name, "unit": series.unit}, {"t_s": series.at_s, "value": series.values}


def _acquisitions(run: StoredRun) -> Iterator[Acquisition]:
    labels = dict.fromkeys(event.data.get("label") for event in run.reader.events("step_ended"))
    for label in filter(None, labels):
        yield from acquisitions(run.reader, run.bench, (), label)


def _acquired(run: StoredRun, kind: _Kind, units: Mapping[str, str]) -> Iterator[Part]:
    """Data of a kind; the first two columns are words. A number valid for a whole acquisition is in every row.

    `units` are those of the values of channels that send codes or decoded values.
    """
    first, second, *others = (name for name in kind.columns if name != "unit")
    for acquisition in _acquisitions(run):
        for channel, found in getattr(acquisition, kind.kept_in).items():
            rows = {name: getattr(found, kind.kept_as.get(name, name)) for name in others}
            count = len(next(iter(rows.values())))
            rows |= {name: np.full(count, rows[name]) for name in FIXED if name in rows}
            words = {first: acquisition.step, second: channel}
            yield words | ({"unit": units[channel]} if "unit" in kind.columns else {}), rows


def _gaps(run: StoredRun) -> Iterator[Part]:
    for acquisition in _acquisitions(run):
        for (device, channel), missed in acquisition.missed.items():
            found = acquisition.codes[channel] if missed.what == "samples" else acquisition.counts[channel]
            yield {"step": acquisition.step, "channel": f"{device}.{channel}"}, gap_columns(found)


def _journal(run: StoredRun) -> Iterator[Part]:
    rows = (
        (event.seq, event.at_s, event.kind, event.step, json.dumps(event.data, ensure_ascii=False))
        for event in run.reader.events()
    )
    while some := list(islice(rows, JOURNAL_ROWS)):
        yield {}, dict(zip(JOURNAL, zip(*some, strict=True), strict=True))
