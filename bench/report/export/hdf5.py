"""A run's data as HDF5: for h5py, MATLAB, LabVIEW, Julia and HDFView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.files import atomic_file
from bench.optional import imported
from bench.reduce.stored_run import StoredRun
from bench.report.export.tables import Column, Table, tables

HDF5 = "run.h5"
ROWS_OF_CHUNK = 1 << 14
_NUMBERS: Mapping[str, Any] = {"chunks": (ROWS_OF_CHUNK,), "shuffle": True, "compression": "gzip"}
# HDF5 stores strings of variable length outside their dataset, uncompressed
_WORDS: Mapping[str, Any] = {"chunks": (256,)}
_ROWS = {
    "first_row": Column("", "where its rows begin in the group rows"),
    "row_count": Column("", "how many there are"),
}


def export_hdf5(run: StoredRun, out: Path) -> list[Path]:
    """Write `run.h5`: groups `readings`, `journal` and one for each kind of output; datasets have unit and description.

    A channel of the readings, or an acquisition by a channel, is one element of the datasets in its group. Its values
    are `row_count` elements, from `first_row` on, of those in the group `rows` below it.
    """
    h5py = imported("h5py", "hdf5")
    path = out / HDF5
    with atomic_file(path) as draft, h5py.File(draft, "w") as file:
        file.attrs.update(run=run.manifest["run"], title=run.manifest["title"], began=run.began.isoformat())
        for name, table in tables(run).items():
            _write(h5py, file.create_group(name), table)
    return [path]


def _write(h5py: Any, group: Any, table: Table) -> None:
    """Write parts, one after the other: each with its words and rows, or only with rows."""
    heads: list[Mapping[str, Any]] = []
    first_row = 0
    for words, rows in table.parts():
        at = group.require_group("rows") if words else group
        for name, values in rows.items():
            _append(h5py, at, name, table.columns[name], values)
        count = len(next(iter(rows.values())))
        heads.append({**words, "first_row": first_row, "row_count": count} if words else {})
        first_row += count
    for name in heads[0] if heads else ():
        _append(h5py, group, name, {**table.columns, **_ROWS}[name], [head[name] for head in heads])


def _append(h5py: Any, group: Any, name: str, column: Column, values: Any) -> None:
    """Append values (n,) to a dataset, which is created with the first ones."""
    is_text = not isinstance(values, np.ndarray) and isinstance(values[0], str)
    values = np.array(values, h5py.string_dtype()) if is_text else np.asarray(values)
    if name not in group:
        form = _WORDS if values.dtype == object else _NUMBERS
        dataset = group.create_dataset(name, (0,), values.dtype, maxshape=(None,), **form)
        dataset.attrs.update(unit=column.unit, description=column.meaning)
    dataset = group[name]
    before = len(dataset)
    dataset.resize((before + len(values),))
    dataset[before:] = values
