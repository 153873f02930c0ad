"""Recorded data of a run in parts, with their column descriptions in files for other programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.metrology.acquisition import Acquisition
from bench.metrology.gaps import EVENT, gap_columns
from bench.reduce.acquisitions import acquisitions
from bench.reduce.stored_run import StoredRun
from bench.store.reader import Event, Series
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
Part = tuple[Mapping[str, str], Mapping[str, NDArray[Any]]]
"""Words constant for some rows, and these rows by their columns."""


Units = Mapping[str, str]
"""Unit of the values of channels that send codes or decoded values."""


@dataclass(frozen=True)
class Acquired:
    """A table of acquired data: its columns, and the rows of an acquisition."""

    columns: Mapping[str, Column]
    rows: Callable[[Acquisition, Units], Iterator[Part]]

    def parts(self, run: StoredRun) -> Iterator[Part]:
        """Raw data of every acquisition, one after the other; raises StoreError."""
        units = _units(run)
        labels = dict.fromkeys(event.data.get("label") for event in run.reader.events("step_ended"))
        for label in filter(None, labels):
            for acquisition in acquisitions(run.reader, run.bench, (), label):
                yield from self.rows(acquisition, units)


def readings(run: StoredRun) -> Iterator[Series]:
    """Readings of every channel, one after the other."""
    return map(run.reader.series, run.reader.channels())


def acquired(run: StoredRun) -> dict[str, Acquired]:
    """Tables of acquired data: counters always, other instruments of the bench, gaps if there are any."""
    also = {
        "samples": bool(_units(run)),
        "positions": any(entry.encoders for entry in run.bench.devices.values()),
        "voltages": bool(run.bench.with_capability("voltmeter")),
        "currents": bool(run.bench.with_capability("ammeter")),
        "gaps": any(True for _ in run.reader.events(EVENT)),
    }
    return {name: table for name, table in ACQUIRED.items() if also.get(name, True)}


def _units(run: StoredRun) -> Units:
    every = (output for entry in run.bench.devices.values() for output in entry.outputs.items())
    return {name: output.unit for name, output in every if isinstance(output, Sampled)}


def _latches(acquisition: Acquisition, _: Units) -> Iterator[Part]:
    for channel, counts in acquisition.counts.items():
        yield _part(LATCHES, (acquisition.step, channel), counts)


def _positions(acquisition: Acquisition, _: Units) -> Iterator[Part]:
    for device, read in acquisition.positions.items():
        yield _part(POSITIONS, (acquisition.step, device), read)


def _samples(acquisition: Acquisition, units: Units) -> Iterator[Part]:
    for channel, codes in acquisition.codes.items():
        words, rows = _part(SAMPLES, (acquisition.step, channel), codes, t_s="host_s", value="values")
        yield {**words, "unit": units[channel]}, rows


def _gaps(acquisition: Acquisition, _: Units) -> Iterator[Part]:
    for (device, channel), missed in acquisition.missed.items():
        found = acquisition.codes[channel] if missed.what == "samples" else acquisition.counts[channel]
        yield {"step": acquisition.step, "channel": f"{device}.{channel}"}, gap_columns(found)


def _voltages(acquisition: Acquisition, _: Units) -> Iterator[Part]:
    for meter, read in acquisition.voltages.items():
        yield _part(VOLTAGES, (acquisition.step, meter), read, t_s="at_s", value="values_v")


def _currents(acquisition: Acquisition, _: Units) -> Iterator[Part]:
    for meter, read in acquisition.currents.items():
        yield _part(CURRENTS, (acquisition.step, meter), read, t_s="at_s", value="values_a")


def _part(columns: Mapping[str, Column], words: tuple[str, str], of: object, **kept_as: str) -> Part:
    """Part of a table: the first two columns are the words, the others have their names, or another.

    A number valid for the whole acquisition is repeated in every row.
    """
    names = tuple(columns)
    rows = {name: getattr(of, kept_as.get(name, name)) for name in names[2:] if name != "unit"}
    count = len(next(iter(rows.values())))
    repeated = {name: np.full(count, rows[name]) for name in FIXED if name in rows}
    return dict(zip(names[:2], words, strict=True)), rows | repeated


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
