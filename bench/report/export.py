"""A run's data as files that other programs read."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from bench.errors import InputError
from bench.report.stored import StoredRun
from drivers.frame_block import EXTENDED, FrameBlock

Exporter = Callable[[StoredRun, Path], list[Path]]


def export_csv(run: StoredRun, out: Path) -> list[Path]:
    """`readings.csv`, `acquisitions.csv` and `journal.csv`; times in seconds of bench time."""
    writers: dict[str, Iterator[Iterable[object]]] = {
        "readings.csv": _readings(run),
        "acquisitions.csv": _acquisitions(run),
        "journal.csv": _journal(run),
    }
    return [_write_csv(out / name, rows) for name, rows in writers.items()]


def _readings(run: StoredRun) -> Iterator[Iterable[object]]:
    yield ("name", "unit", "t_s", "value")
    for name in run.reader.channels():
        series = run.reader.series(name)
        for at_s, value in zip(series.at_s.tolist(), series.values.tolist(), strict=True):
            yield (name, series.unit, f"{at_s:.6f}", repr(value))


def _acquisitions(run: StoredRun) -> Iterator[Iterable[object]]:
    """Every latch of every channel: raw counters, as they were on the wire."""
    yield ("step", "channel", "sequence", "tick", "positive", "negative")
    for label in dict.fromkeys(entry.data for entry in run.sequence.results):
        for acquisition in run.data(label).acquisitions:
            for channel, counts in acquisition.counts.items():
                columns = (counts.sequence, counts.tick, counts.positive, counts.negative)
                for row in np.stack(columns, axis=-1).tolist():
                    yield (acquisition.step, channel, *row)


def _journal(run: StoredRun) -> Iterator[Iterable[object]]:
    yield ("seq", "t_s", "kind", "step", "data")
    for event in run.reader.events():
        yield (event.seq, f"{event.at_s:.6f}", event.kind, event.step, dict(event.data))


def _write_csv(path: Path, rows: Iterable[Iterable[object]]) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows)
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem})") from problem
    return path


def export_candump(run: StoredRun, out: Path) -> list[Path]:
    """`STREAM.log` for each counter, as can-utils' `candump -l` writes it; the DBC of the run decodes it.

    Times are seconds since 1970, counted from the beginning of the run.
    """
    streams: dict[str, list[FrameBlock]] = {}
    for stream, _, block in run.reader.blocks():
        streams.setdefault(stream, []).append(block)
    began = next(run.reader.events("run_begins"), None)
    epoch_s = run.began.timestamp() - (began.at_s if began else 0.0)
    paths = []
    for stream, blocks in streams.items():
        path = out / f"{stream}.log"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("w", encoding="ascii") as file:
                for block in blocks:
                    file.writelines(_candump_lines(block, epoch_s))
        except OSError as problem:
            raise InputError(f"{path}: cannot be written ({problem})") from problem
        paths.append(path)
    return paths


def _candump_lines(block: FrameBlock, epoch_s: float) -> Iterator[str]:
    columns = (block.ids.tolist(), (block.at_s + epoch_s).tolist(), block.dlc.tolist(), block.data)
    for frame_id, at_s, length, data in zip(*columns, strict=True):
        name = f"{frame_id & ~EXTENDED:08X}" if frame_id & EXTENDED else f"{frame_id:03X}"
        yield f"({at_s:.6f}) can0 {name}#{data[:length].tobytes().hex().upper()}\n"


FORMATS: dict[str, Exporter] = {"csv": export_csv, "candump": export_candump}
