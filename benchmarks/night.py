"""The night of an inertial unit (method M2) in virtual time, six channels at 100 Hz, for the rows that need one."""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmarks.timed_run import CONFIG, Timed, timed_run

SEQUENCE = "imu_24_position"
PART = ("offsets=[0 °C, 30 °C, -40 °C]",)  # three set points instead of eleven, all else as in the whole night


def night(folder: Path, whole: bool) -> Timed:
    """The whole night, or a part of it with the same share of measuring; every wire simulated, and durable."""
    bench = folder / "config" / "imu_100_hz.yaml"
    if not bench.exists():
        shutil.copytree(CONFIG, folder / "config")
        text = (CONFIG / "imu.yaml").read_text("utf-8")
        bench.write_text(text.replace("period: 100 ms", "period: 10 ms"), "utf-8")
    return timed_run(SEQUENCE, bench, folder / "runs", settings=() if whole else PART)
