"""Rows of counts to HDF5 with one writer, many readers (SWMR), flushed block by block, and back: ROWS, BLOCK, FILTER.

ROWS is a file of NumPy with one row of integers for each latch; FILTER is `gzip` (level 1, shuffled) or `plain`. Each
column is a dataset, of 32 bits where they suffice.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

rows, block = np.load(sys.argv[1]), int(sys.argv[2])
columns = [np.ascontiguousarray(column, "i8" if column.max() >= 1 << 31 else "i4") for column in rows.T]
packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if sys.argv[3] == "gzip" else {}
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "run.h5"
    began_s = time.perf_counter()
    with h5py.File(path, "w", libver="latest") as file:
        given = {"shape": (0,), "maxshape": (None,), "chunks": (block,), **packed}
        sets = [file.create_dataset(f"column_{at}", dtype=each.dtype, **given) for at, each in enumerate(columns)]
        file.swmr_mode = True
        for at in range(0, len(rows), block):
            for stored, column in zip(sets, columns, strict=True):
                part = column[at : at + block]
                stored.resize((at + len(part),))
                stored[at:] = part
                stored.flush()
    write_s = time.perf_counter() - began_s
    began_s = time.perf_counter()
    with h5py.File(path, "r", libver="latest", swmr=True) as file:
        found = [file[f"column_{number}"][:] for number in range(len(columns))]
    read_s = time.perf_counter() - began_s
    size = path.stat().st_size
assert all(np.array_equal(*each) for each in zip(found, columns, strict=True))
print(json.dumps({"rows": len(rows), "write_s": write_s, "read_s": read_s, "bytes": size}))
