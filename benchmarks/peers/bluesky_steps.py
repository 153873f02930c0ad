"""Events a second of the RunEngine with its writer of JSON lines: COUNT, and `plain` or `ophyd-async`."""

import json
import sys
import tempfile
import time

import bluesky.plans as bp
from bluesky import RunEngine
from bluesky.callbacks.json_writer import JSONLinesWriter
from ophyd_async.core import StandardReadable, init_devices, soft_signal_rw


class Plain:
    """The least that the RunEngine accepts as a device."""

    name, parent = "plain", None

    def read(self) -> dict:
        """One value."""
        return {"plain": {"value": 5.0, "timestamp": time.time()}}

    def describe(self) -> dict:
        """What the value is."""
        return {"plain": {"source": "none", "dtype": "number", "shape": []}}

    def read_configuration(self) -> dict:
        """Nothing."""
        return {}

    describe_configuration = read_configuration


class Soft(StandardReadable):
    """A device of ophyd-async with one signal in memory."""

    def __init__(self, name: str = "") -> None:
        with self.add_children_as_readables():
            self.value = soft_signal_rw(float)
        super().__init__(name)


count, kind = int(sys.argv[1]), sys.argv[2]
engine = RunEngine({})
if kind == "plain":
    device = Plain()
else:
    with init_devices():
        device = Soft("soft")
with tempfile.TemporaryDirectory() as folder:
    engine.subscribe(JSONLinesWriter(folder, "run.jsonl"))
    engine(bp.count([device], num=10))
    began_s = time.perf_counter()
    engine(bp.count([device], num=count))
    took_s = time.perf_counter() - began_s
print(json.dumps({"steps_per_s": count / took_s}))
