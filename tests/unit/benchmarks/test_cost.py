"""Processor time and memory of processes."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.cost import cost_of

ROOT = Path(__file__).parents[3]
LARGE = b"x" * 100_000_000  # makes the process of the tests larger than those that it measures


def test_the_memory_of_a_process_is_not_that_of_the_one_that_measures_it() -> None:
    measuring = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    cost = cost_of([sys.executable, "-S", "-c", "x = bytearray(20_000_000)"])
    assert cost.memory is not None
    assert 20 < cost.memory < 45 < len(LARGE) / 1e6 < measuring
    with pytest.raises(RuntimeError, match="exit 3 of"):
        cost_of([sys.executable, "-S", "-c", "raise SystemExit(3)"])


def test_the_memory_that_a_process_finds_of_itself_is_not_that_of_the_one_that_started_it() -> None:
    measuring = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    code = "from benchmarks.cost import peak_mb\nx = bytearray(20_000_000)\nprint(peak_mb())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert 20 < float(done.stdout) < 45 < len(LARGE) / 1e6 < measuring
