"""A run's data for MATLAB and Octave: one MAT-file of version 5 with struct arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.files import atomic_file
from bench.reduce.stored_run import StoredRun
from bench.report.export.tables import Table, tables

MATLAB = "run.mat"


def export_matlab(run: StoredRun, out: Path) -> list[Path]:
    """Write `run.mat` with struct arrays `readings`, `journal` and one of each kind of output, and the struct `run`.

    An element of `readings` is a channel, of an output an acquisition by a channel, of `journal` an event; series are
    columns. A variable of a MAT-file cannot be written in parts, so all data are in memory at once; InputError if they
    exceed the format.
    """
    from scipy.io import savemat
    from scipy.io.matlab import MatWriteError

    found = tables(run)
    content = {"run": _about(run, found), **{name: _structs(table) for name, table in found.items()}}
    path = out / MATLAB
    try:
        with atomic_file(path) as draft:
            savemat(draft, content, appendmat=False, do_compression=True, oned_as="column")
    except MatWriteError as problem:
        raise InputError(f"{path}: cannot be written ({problem}); --format hdf5 has no limit of size") from problem
    return [path]


def _about(run: StoredRun, found: Mapping[str, Table]) -> Mapping[str, Any]:
    """Content of `run` in MATLAB: identification of the run, and the unit of each column with one."""
    units = {
        name: {key: column.unit for key, column in table.columns.items() if column.unit}
        for name, table in found.items()
    }
    return {"id": run.manifest["run"], "title": run.manifest["title"], "began": run.began.isoformat(), "units": units}


def _structs(table: Table) -> NDArray[Any]:
    """A struct array (n, 1) with a field for each column; names are valid in MATLAB."""
    found: list[tuple[object, ...]] = []
    for words, rows in table.parts():
        found += [(*words.values(), *rows.values())] if words else zip(*rows.values(), strict=True)
    array = np.empty((len(found), 1), dtype=[(name, object) for name in table.columns])
    for index, row in enumerate(found):
        array[index, 0] = row
    return array
