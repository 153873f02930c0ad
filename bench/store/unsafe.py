"""A record, outside of a run's directory, of devices that a run could not make safe."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from bench.errors import StoreError
from bench.files import write_whole
from bench.store.runs import json_text
from bench.store.user_state import state_folder

SCHEMA = "itb-unsafe/1"
FOLDER = "unsafe"


def keep_unsafe(run: Path, at: datetime, unsafe: Mapping[str, str], connections: Mapping[str, str]) -> Path:
    """Write which devices may still be energised, and why; the file. Raises StoreError.

    `connections` are the addresses of devices by role.
    """
    try:
        folder = state_folder() / FOLDER
        folder.mkdir(exist_ok=True)
    except OSError as problem:
        raise StoreError(f"the record of devices that are not safe cannot be written ({problem})") from problem
    path = folder / f"{run.name}.json"
    content = {
        "schema": SCHEMA,
        "run": str(run.absolute()),
        "at": at.isoformat(timespec="seconds"),
        "unsafe": {role: {"why": why, "connection": connections.get(role, "")} for role, why in unsafe.items()},
    }
    write_whole(path, json_text(content).encode())
    return path
