"""A run's data as HDF5: for h5py, MATLAB, LabVIEW, Julia and HDFView."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from bench.report.export.tables import JOURNAL, READINGS, Column, acquired, journal, readings
from bench.report.optional import imported

HDF5 = "run.h5"
ROWS_OF_CHUNK = 1 << 14
_NUMBERS: Mapping[str, Any] = {"chunks": (ROWS_OF_CHUNK,), "shuffle": True, "compression": "gzip"}
# HDF5 stores strings of variable length outside their dataset, uncompressed
_WORDS: Mapping[str, Any] = {"chunks": (256,)}
_ROWS = {
    "first_row": Column("", "where its rows begin in the group rows"),
    "row_count": Column("", "how many there are"),
}
Values = Mapping[str, Any]


def export_hdf5(run: StoredRun, out: Path) -> list[Path]:
    """Write `run.h5`: groups `readings`, `journal` and one for each kind of output; datasets have unit and description.

    A channel of the readings, or an acquisition by a channel, is one element of the datasets in its group. Its values
    are `row_count` elements, from `first_row` on, of those in the group `rows` below it.
    """
    h5py = imported("h5py", "hdf5")
    path = out / HDF5
    with atomic_file(path) as draft, h5py.File(draft, "w") as file:
        file.attrs.update(run=run.manifest["run"], title=run.manifest["title"], began=run.began.isoformat())
        _write_series(h5py, file.create_group("readings"), READINGS, _readings(run))
        for name, table in acquired(run).items():
            _write_series(h5py, file.create_group(name), table.columns, table.parts(run))
        _write_journal(h5py, file.create_group("journal"), run)
    return [path]


def _readings(run: StoredRun) -> Iterator[tuple[Values, Values]]:
    for series in readings(run):
        yield {"name": series.name, "unit": series.unit}, {"t_s": series.at_s, "value": series.values}


def _write_series(h5py: Any, group: Any, columns: Mapping[str, Column], parts: Iterator[tuple[Values, Values]]) -> None:
    """Write parts, each with its words and rows, one after the other."""
    heads: list[Values] = []
    below = group.create_group("rows")
    first_row = 0
    for words, rows in parts:
        for name, values in rows.items():
            _append(below, name, columns[name], values)
        count = len(next(iter(rows.values())))
        heads.append({**words, "first_row": first_row, "row_count": count})
        first_row += count
    for name in heads[0] if heads else ():
        values = [head[name] for head in heads]
        _append(group, name, {**columns, **_ROWS}[name], _of_words(h5py, values) if name in columns else values)


def _write_journal(h5py: Any, group: Any, run: StoredRun) -> None:
    rows = ((event.seq, event.at_s, event.kind, event.step, data) for event, data in journal(run))
    while some := list(islice(rows, ROWS_OF_CHUNK)):
        for (name, column), values in zip(JOURNAL.items(), zip(*some, strict=True), strict=True):
            _append(group, name, column, _of_words(h5py, values) if isinstance(values[0], str) else values)


def _of_words(h5py: Any, words: Sequence[str]) -> Any:
    return np.array(words, h5py.string_dtype())


def _append(group: Any, name: str, column: Column, values: Any) -> None:
    """Append values (n,) to a dataset, which is created with the first ones."""
    values = np.asarray(values)
    if name not in group:
        form = _WORDS if values.dtype == object else _NUMBERS
        dataset = group.create_dataset(name, (0,), values.dtype, maxshape=(None,), **form)
        dataset.attrs.update(unit=column.unit, description=column.meaning)
    dataset = group[name]
    before = len(dataset)
    dataset.resize((before + len(values),))
    dataset[before:] = values
