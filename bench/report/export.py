"""A run's data as files that other programs read."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from bench.errors import InputError
from bench.report.export_hdf5 import export_hdf5
from bench.report.export_matlab import export_matlab
from bench.report.export_parquet import export_parquet
from bench.report.recorded import JOURNAL, READINGS, TIMES, Acquired, acquired, journal, readings
from bench.report.stored import StoredRun
from drivers.frame_block import EXTENDED, FrameBlock

Exporter = Callable[[StoredRun, Path], list[Path]]


def export_csv(run: StoredRun, out: Path) -> list[Path]:
    """`readings.csv`, `journal.csv` and a table of each kind of output; times in seconds of bench time."""
    writers: dict[str, Iterator[Iterable[object]]] = {
        "readings": _readings(run),
        **{name: _acquired(run, table) for name, table in acquired(run).items()},
        "journal": _journal(run),
    }
    return [_write_csv(out / f"{name}.csv", rows) for name, rows in writers.items()]


def _readings(run: StoredRun) -> Iterator[Iterable[object]]:
    yield READINGS
    for series in readings(run):
        for at_s, value in zip(series.at_s.tolist(), series.values.tolist(), strict=True):
            yield (series.name, series.unit, f"{at_s:.6f}", repr(value))


def _acquired(run: StoredRun, table: Acquired) -> Iterator[Iterable[object]]:
    yield table.columns
    for words, columns in table.parts(run):
        spelled = [
            [f"{value:.6f}" for value in values.tolist()] if name in TIMES else map(repr, values.tolist())
            for name, values in columns.items()
        ]
        for row in zip(*spelled, strict=True):
            yield (*words.values(), *row)


def _journal(run: StoredRun) -> Iterator[Iterable[object]]:
    yield JOURNAL
    for event, data in journal(run):
        yield (event.seq, f"{event.at_s:.6f}", event.kind, event.step, data)


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


FORMATS: dict[str, Exporter] = {
    "csv": export_csv,
    "candump": export_candump,
    "parquet": export_parquet,
    "matlab": export_matlab,
    "hdf5": export_hdf5,
}
