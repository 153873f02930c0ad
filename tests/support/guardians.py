"""The guardian of a run as the computer shows it."""

from __future__ import annotations

import contextlib
import os
import signal
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


def has_made_safe(run: Path | None) -> bool:
    """Return whether the guardian of a run that was lost is through with making its bench safe; it may follow a
    chamber."""
    with contextlib.suppress(OSError):
        return run is not None and '"event": "ends"' in (run / "incident.jsonl").read_text("utf-8")
    return False


def has_ended(process: int) -> bool:
    """Return whether a process is gone, or waits for nothing but its parent."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text("ascii").split()[2] == "Z"
    return True
