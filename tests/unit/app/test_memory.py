"""Memory of a block that was computed is there for the next one, and not given back to the system."""

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource
import numpy as np
from bench.memory import keep_freed_memory

if {kept}:
    keep_freed_memory()

def block():
    return [np.ones(42_000) for _ in range(9)]

block()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    block()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(*, kept: bool) -> int:
    """Pages that the system had to give for 20 blocks of 3 MB, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", FAULTS.format(kept=kept)], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the thresholds of another C library are its own")
def test_a_block_is_computed_in_the_memory_of_the_one_before() -> None:
    assert faults(kept=True) < faults(kept=False) / 10
