"""The guardian of a run as the computer shows it."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path


def guardian_of(run: int) -> int:
    """The process number of the guardian of a run's process."""
    children = Path(f"/proc/{run}/task/{run}/children").read_text("ascii").split()
    (found,) = (int(each) for each in children if b"bench.guardian" in Path(f"/proc/{each}/cmdline").read_bytes())
    return found


def stop(process: int) -> None:
    """Stop a child; returns when all of its threads stand, before which another signal would be met first."""
    os.kill(process, signal.SIGSTOP)
    os.waitpid(process, os.WUNTRACED)


def until(holds: Callable[[], object], within_s: float, why: Callable[[], str] = str) -> None:
    """Wait until a condition is true; fails after `within_s`, with the text of `why`."""
    end_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end_s, why()
        time.sleep(0.05)


def has_made_safe(run: Path | None) -> bool:
    """Return whether the guardian of a lost run has recorded, in the directory of the run, the end of its rescue.

    It may still have to write the records of the machine, and to supervise chambers.
    """
    with contextlib.suppress(OSError):
        return run is not None and '"event": "ends"' in (run / "incident.jsonl").read_text("utf-8")
    return False


def has_ended(process: int) -> bool:
    """Return whether a process is gone, or waits for nothing but its parent."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text("ascii").split()[2] == "Z"
    return True
