"""Phases a second of OpenHTF, each with one measurement within limits; the record is a JSON file at the end: COUNT."""

import json
import sys

import openhtf as htf
from openhtf_run import executed


def phase(number: int) -> htf.PhaseDescriptor:
    """A phase that measures a constant."""

    @htf.PhaseOptions(name=f"phase_{number}")
    @htf.measures(htf.Measurement(f"m_{number}").in_range(0, 10))
    def measured(test: htf.TestApi) -> None:
        test.measurements[f"m_{number}"] = 5.0

    return measured


count = int(sys.argv[1])
phases = [phase(number) for number in range(count)]
took_s = executed(phases, "steps")
print(json.dumps({"steps_per_s": count / took_s}))
