"""Tests and trials; none of them writes into the home of who runs it."""

import os
import tempfile

_PREFIX = "itb-state-"
if _PREFIX not in os.environ.get("XDG_STATE_HOME", ""):  # a process that a test has started has it already
    _STATE = tempfile.TemporaryDirectory(prefix=_PREFIX)
    os.environ["XDG_STATE_HOME"] = _STATE.name

os.environ.setdefault("INERTIAL_TEST_BENCH_MACHINE", "/no/machine/in/tests")  # nor into the records of its computer
