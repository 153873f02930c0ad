"""A test of OpenHTF whose record is a JSON file at the end, and how long it takes."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import openhtf as htf
from openhtf.output.callbacks import json_factory
from openhtf.util import configuration, console_output

configuration.CONF.load(capture_source=False)
console_output.CLI_QUIET = True


def executed(phases: Sequence[htf.PhaseDescriptor], name: str) -> float:
    """Execute phases; return the seconds they took."""
    with tempfile.TemporaryDirectory() as folder:
        test = htf.Test(*phases, test_name=name)
        test.add_output_callbacks(json_factory.OutputToJSON(str(Path(folder) / "record.json")))
        began_s = time.perf_counter()
        assert test.execute(test_start=lambda: "unit 1")
        return time.perf_counter() - began_s
