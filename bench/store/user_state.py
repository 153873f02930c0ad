"""The folder of this user's records that belong to no single run, such as what was not made safe."""

from __future__ import annotations

import os
from pathlib import Path

NAME = "inertial-test-bench"


def state_folder() -> Path:
    """`$XDG_STATE_HOME/inertial-test-bench`, or the same below `~/.local/state`; made if missing. Raises OSError.

    Only this user may look into it. A relative XDG_STATE_HOME is passed over, as its specification asks for.
    """
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    folder = (given if given.is_absolute() else Path.home() / ".local" / "state") / NAME
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder
