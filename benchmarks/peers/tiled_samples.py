"""Rows of counts as events of the RunEngine through the TiledWriter to a Tiled server, and back: ROWS.

ROWS is a file of NumPy with one row of integers for each latch. The server is in this process, with its SQLite storage.
"""

import json
import logging
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import bluesky.plans as bp
import numpy as np
from bluesky import RunEngine
from bluesky.callbacks.tiled_writer import TiledWriter
from tiled.client import from_uri
from tiled.server import SimpleTiledServer

warnings.simplefilter("ignore")
logging.disable(logging.CRITICAL)
rows = np.load(sys.argv[1])
names = [f"column_{number}" for number in range(rows.shape[1])]


class Counter:
    """The least that the RunEngine accepts as a device; each reading is the next row."""

    name, parent = "counter", None

    def __init__(self) -> None:
        self._rows: Iterator[list[int]] = iter(rows.tolist())

    def read(self) -> dict:
        """The next row."""
        now_s = time.time()
        return {name: {"value": each, "timestamp": now_s} for name, each in zip(names, next(self._rows), strict=True)}

    def describe(self) -> dict:
        """What the values are."""
        return {name: {"source": "none", "dtype": "integer", "shape": []} for name in names}

    def read_configuration(self) -> dict:
        """Nothing."""
        return {}

    describe_configuration = read_configuration


with tempfile.TemporaryDirectory() as folder, SimpleTiledServer(directory=folder) as server:
    engine = RunEngine({})
    engine.subscribe(TiledWriter.from_uri(server.uri))
    before = sum(each.stat().st_size for each in Path(folder).rglob("*") if each.is_file())
    began_s = time.perf_counter()
    (run,) = engine(bp.count([Counter()], num=len(rows)))
    write_s = time.perf_counter() - began_s
    size = sum(each.stat().st_size for each in Path(folder).rglob("*") if each.is_file()) - before
    began_s = time.perf_counter()
    table = from_uri(server.uri)[run]["primary"].read(variables=names)
    found = np.stack([np.asarray(table[name]) for name in names], axis=1)
    read_s = time.perf_counter() - began_s
assert np.array_equal(found, rows)
print(json.dumps({"rows": len(rows), "write_s": write_s, "read_s": read_s, "bytes": size}))
