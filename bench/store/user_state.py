"""Folder for records of this user that belong to no single run, such as devices that were not made safe."""

from __future__ import annotations

import os
from pathlib import Path

NAME = "inertial-test-bench"


def state_folder() -> Path:
    """Return `$XDG_STATE_HOME/inertial-test-bench`, by default below `~/.local/state`. Raises OSError.

    It is created if missing, readable by this user only. A relative XDG_STATE_HOME is ignored, as its specification
    requires.
    """
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    folder = (given if given.is_absolute() else Path.home() / ".local" / "state") / NAME
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder
