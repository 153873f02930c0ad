"""Behaviour of ext4 for a write interrupted by a power cut, independent of this project's code.

    python -m campaigns.reliability.in_flight 300

A process appends and calls `fdatasync`, again and again, and says how often that has returned; then the file system is
shut down as the trials of power cuts do it. What returned before the cut must be on the disk. What returns after it
began need not: the kernel drops the transaction that the call waits for, and the call still succeeds.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from campaigns.trials.record import Running, cut_off, ext4, mounted

APPENDED_BYTES = 24_000  # about what one commit of a run writes
SETTLES_S = 0.02
WRITER = f"""
import os, sys
file = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)
done = 0
while True:
    os.write(file, bytes({APPENDED_BYTES}))
    os.fdatasync(file)
    done += 1
    os.write(1, b"%d\\n" % done)
"""


def main(cuts: int) -> int:
    """Cut so often, and print how often what had returned was not there; 1 if it had returned before the cut."""
    draw = np.random.default_rng(1)
    lost_before = lost_after = 0
    with tempfile.TemporaryDirectory() as folder:
        image, disk = ext4(Path(folder))
        for delay_s in draw.uniform(0.03, 0.15, cuts):
            before, after, kept = cut_once(image, disk, float(delay_s))
            lost_before += kept < before
            lost_after += before <= kept < after
    print(f"{cuts} cuts: {lost_before} lost what had returned before the cut, {lost_after} what returned after it")
    return 1 if lost_before else 0


def cut_once(image: Path, disk: Path, delay_s: float) -> tuple[int, int, int]:
    """Appends that had returned before the cut, that had returned in the end, and that are on the disk."""
    path = disk / "appended"
    with (
        mounted(image, disk),
        subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as writer,
    ):
        assert writer.stdout is not None
        appending = Running(writer, writer.stdout.fileno())
        time.sleep(delay_s)
        before = appending.acknowledged
        cut_off(disk)
        time.sleep(SETTLES_S)
        writer.kill()
        after = appending.acknowledged
    with mounted(image, disk):
        kept = path.stat().st_size // APPENDED_BYTES if path.exists() else 0
        path.unlink(missing_ok=True)
    return before, after, kept


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
