"""The guardian of a run as the computer shows it."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path


def guardian_of(run: int) -> int:
    """The process number of the guardian of a run's process."""
    children = Path(f"/proc/{run}/task/{run}/children").read_text("ascii").split()
    (found,) = (int(each) for each in children if b"bench.guardian" in Path(f"/proc/{each}/cmdline").read_bytes())
    return found


def stop(process: int) -> None:
    """Stop a process; returns when it stands still, before which another signal would be met first."""
    os.kill(process, signal.SIGSTOP)
    while Path(f"/proc/{process}/stat").read_text("ascii").rpartition(")")[2].split()[0] != "T":
        time.sleep(0.001)


def has_ended(process: int) -> bool:
    """Whether a process is gone, or waits for nothing but its parent."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text("ascii").split()[2] == "Z"
    return True
