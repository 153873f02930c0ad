"""Rows of counts through the worker and the recorder of PyMeasure to a CSV file, and back: ROWS.

ROWS is a file of NumPy with one row of integers for each latch.
"""

import json
import logging
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from pymeasure.experiment import Procedure, Results
from pymeasure.experiment.workers import Worker

logging.getLogger("pymeasure").setLevel(logging.CRITICAL)
rows = np.load(sys.argv[1])
names = [f"column_{number}" for number in range(rows.shape[1])]
plain = rows.tolist()


class Night(Procedure):
    """Emits the rows."""

    DATA_COLUMNS = names

    def execute(self) -> None:
        """One by one."""
        for row in plain:
            self.emit("results", dict(zip(names, row, strict=True)))


def is_written(path: Path) -> bool:
    """True if the last row is in the file."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - 400))
        last = file.read().rstrip().rpartition(b"\n")[2].split(b",")
    return last == [str(value).encode() for value in plain[-1]]


with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "night.csv"
    worker = Worker(Results(Night(), str(path)), log_level=logging.CRITICAL)
    began_s = time.perf_counter()
    worker.start()
    while not is_written(path):
        time.sleep(0.005)
    write_s = time.perf_counter() - began_s
    began_s = time.perf_counter()
    found = Results.load(str(path)).data.to_numpy()
    read_s = time.perf_counter() - began_s
    size = path.stat().st_size
assert np.array_equal(found, rows)
print(json.dumps({"rows": len(rows), "write_s": write_s, "read_s": read_s, "bytes": size}), flush=True)
os._exit(0)  # the worker's thread may still wait for listeners
