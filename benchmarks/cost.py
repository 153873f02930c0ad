"""Processor time and largest memory of processes.

The kernel's `ru_maxrss` of a process is at least that of the process that started it, also after it has become another
program: https://man7.org/linux/man-pages/man2/getrusage.2.html. Hence a small process in between, and `VmHWM`.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
NOT_JUDGED = 5  # exit code of a run without limits
STARTED = """\
import json, resource, subprocess, sys
nowhere = subprocess.DEVNULL
ended = subprocess.run(sys.argv[1:], stdin=nowhere, stdout=nowhere, stderr=nowhere)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
cost = {"processor_s": used.ru_utime + used.ru_stime, "memory_mb": used.ru_maxrss / 1024}
print(json.dumps({"exit": ended.returncode, **cost}))
"""


class Cost(NamedTuple):
    """Processor time in s and largest memory in MB of a process, or what else was measured of it."""

    processor: float
    memory: float | None = None


def cost_of(command: Sequence[str | Path]) -> Cost:
    """What a process costs, with the children it waited for. Raises RuntimeError if it fails."""
    started = [sys.executable, "-c", STARTED, *map(str, command)]
    found = json.loads(subprocess.run(started, check=True, capture_output=True, text=True, cwd=ROOT).stdout)
    if found["exit"] not in (0, NOT_JUDGED):
        raise RuntimeError(f"exit {found['exit']} of {' '.join(map(str, command))}")
    return Cost(found["processor_s"], found["memory_mb"])


def peak_mb() -> float:
    """Largest memory of this process so far, in MB."""
    lines = Path("/proc/self/status").read_text("ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024
