"""Isolation of a worker: it has no rights to a bench, and writes no record of its user."""

from __future__ import annotations

import os
import tempfile
from functools import lru_cache
from pathlib import Path

from bench.store.machine_state import VARIABLE
from drivers.transport.wires import SIMULATED_ONLY


@lru_cache(maxsize=1)
def isolate() -> Path:
    """Let this process and its children refuse real connections, and keep their records in a folder of their own.

    Returns the folder for temporary files of this process.
    """
    folder = Path(tempfile.mkdtemp(prefix="bench-campaign-", dir=_local_folder()))
    os.environ[SIMULATED_ONLY] = "1"
    os.environ[VARIABLE] = str(folder / "no-machine")  # which does not exist: nothing shared is read or written
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    return folder


def _local_folder() -> str | None:
    """Return the folder that the worker's supervisor removes, also after a kill; None outside of a worker."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:
        return None
