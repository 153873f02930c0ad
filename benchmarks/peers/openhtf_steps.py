"""Phases a second of OpenHTF, each with one measurement within limits; the record is a JSON file at the end: COUNT."""

import json
import sys
import tempfile
import time
from pathlib import Path

import openhtf as htf
from openhtf.output.callbacks import json_factory
from openhtf.util import configuration, console_output

configuration.CONF.load(capture_source=False)
console_output.CLI_QUIET = True


def phase(number: int) -> htf.PhaseDescriptor:
    """A phase that measures a constant."""

    @htf.PhaseOptions(name=f"phase_{number}")
    @htf.measures(htf.Measurement(f"m_{number}").in_range(0, 10))
    def measured(test: htf.TestApi) -> None:
        test.measurements[f"m_{number}"] = 5.0

    return measured


count = int(sys.argv[1])
phases = [phase(number) for number in range(count)]
with tempfile.TemporaryDirectory() as folder:
    test = htf.Test(*phases, test_name="steps")
    test.add_output_callbacks(json_factory.OutputToJSON(str(Path(folder) / "record.json")))
    began_s = time.perf_counter()
    assert test.execute(test_start=lambda: "unit 1")
    took_s = time.perf_counter() - began_s
print(json.dumps({"steps_per_s": count / took_s}))
