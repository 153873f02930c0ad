"""Rows of counts to the SQLite store of QCoDeS, a commit for each block of arrays, and back: ROWS, BLOCK.

ROWS is a file of NumPy with one row of integers for each latch.
"""

import json
import logging
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from qcodes.dataset import Measurement, initialise_or_create_database_at, load_by_id, load_or_create_experiment

logging.disable(logging.CRITICAL)
block = int(sys.argv[2])
rows = np.load(sys.argv[1])
rows = rows[: len(rows) // block * block]  # of blocks of different lengths it makes arrays of objects
columns = [np.ascontiguousarray(column) for column in rows.T]
names = [f"column_{number}" for number in range(len(columns))]
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "qcodes.db"
    initialise_or_create_database_at(path)
    measurement = Measurement(exp=load_or_create_experiment("night", "unit 1"))
    for name in names:
        measurement.register_custom_parameter(name, paramtype="array")
    empty = path.stat().st_size
    began_s = time.perf_counter()
    with measurement.run() as saver:
        for at in range(0, len(rows), block):
            saver.add_result(*((name, each[at : at + block]) for name, each in zip(names, columns, strict=True)))
            saver.flush_data_to_database()
    write_s = time.perf_counter() - began_s
    size = sum(each.stat().st_size for each in path.parent.iterdir()) - empty
    began_s = time.perf_counter()
    data = load_by_id(saver.run_id).get_parameter_data()
    found = [np.ravel(data[name][name]) for name in names]
    read_s = time.perf_counter() - began_s
assert all(np.array_equal(*each) for each in zip(found, columns, strict=True))
print(json.dumps({"rows": len(rows), "write_s": write_s, "read_s": read_s, "bytes": size}))
