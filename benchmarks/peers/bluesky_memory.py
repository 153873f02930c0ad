"""Peak memory in MB of the RunEngine after COUNT readings of a signal in memory, whose documents are kept in a list."""

import json
import sys
from pathlib import Path

import bluesky.plans as bp
from bluesky import RunEngine
from ophyd_async.core import StandardReadable, init_devices, soft_signal_rw


class Thermometer(StandardReadable):
    """A device with one signal."""

    def __init__(self, name: str = "") -> None:
        with self.add_children_as_readables():
            self.temperature = soft_signal_rw(float)
        super().__init__(name)


engine, documents = RunEngine({}), []
engine.subscribe(lambda name, document: documents.append((name, document)))
with init_devices():
    thermometer = Thermometer("thermometer")
engine(bp.count([thermometer], num=int(sys.argv[1])))
lines = Path("/proc/self/status").read_text("ascii").splitlines()
peak_kb = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))  # ru_maxrss has that of the parent
print(json.dumps({"peak_mb": peak_kb / 1024}))
