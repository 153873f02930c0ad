"""P7: memory over the length of a night, its report included, beside Bluesky's documents kept in memory.

Memory is the same in every round, so that each length is run once.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.compared import Row, Side
from benchmarks.peers import figures, version_of

ROOT = Path(__file__).parents[2]
MORE = 1.05
READINGS_PER_H = 3600
FEW, MANY = 5_000, 30_000  # readings by Bluesky, some 2,000 a second


def measure(whole: bool) -> Iterator[Row]:
    """MB that 100 h more take, with a reading a second."""
    short_h, *longer = (15, 150, 1500) if whole else (15, 60)
    peer = Side(f"Bluesky {version_of('bluesky', 'bluesky')}", "none", (bluesky_mb_per_100_h(),))
    short_mb = night_mb(short_h)
    for long_h in longer:
        long_mb = night_mb(long_h)
        more_mb = max(0.0, long_mb - short_mb)
        ours = Side("this program", "each step on the disk", (100 * more_mb / (long_h - short_h),))
        work = f"memory of 100 h more: {short_mb:.0f} MB for a night of {short_h} h, {long_mb:.0f} MB for {long_h} h"
        goal = f"{long_h} h ≤ {MORE} × {short_h} h"
        yield Row("P7", work, "MB", ours, (peer,), "", goal, long_mb <= MORE * short_mb)


def night_mb(hours: int) -> float:
    """Peak memory of a night in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.long_night", str(hours)]
    return float(subprocess.run(command, cwd=ROOT, check=True, text=True, capture_output=True).stdout)


def bluesky_mb_per_100_h() -> float:
    """What the documents of as many readings take as a run makes in 100 h."""
    few_mb, many_mb = (figures("bluesky", "bluesky_memory.py", str(count))["peak_mb"] for count in (FEW, MANY))
    return float((many_mb - few_mb) * 100 * READINGS_PER_H / (MANY - FEW))
