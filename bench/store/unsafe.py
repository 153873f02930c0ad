"""Record, outside the run directory, of devices that a run could not make safe."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from bench.errors import StoreError
from bench.store.kept_json import TEXT, named, object_of, one_of, read_kept
from bench.store.machine_state import folder_to_write, records, write_record
from bench.store.runs import json_text

SCHEMA = "itb-unsafe/1"
FOLDER = "unsafe"
_DEVICE = object_of({"why": TEXT, "connection": TEXT}, ("why",))
_FORM = object_of({"schema": one_of(SCHEMA), "run": TEXT, "at": TEXT, "unsafe": named(_DEVICE)}, ("run", "unsafe"))


def write_unsafe(run: Path, at: datetime, unsafe: Mapping[str, str], connections: Mapping[str, str]) -> Path:
    """Write the devices that may still be energised, with the reasons; return the file. Raises StoreError.

    `connections` are the addresses of devices by role.
    """
    try:
        folder = folder_to_write(FOLDER)
    except OSError as problem:
        raise StoreError(f"the record of devices that are not safe cannot be written ({problem})") from problem
    of_path = hashlib.sha256(str(run.absolute()).encode()).hexdigest()[:8]  # runs of two users may have the same name
    path = folder / f"{run.name}.{of_path}.json"
    content = {
        "schema": SCHEMA,
        "run": str(run.absolute()),
        "at": at.isoformat(timespec="seconds"),
        "unsafe": {role: {"why": why, "connection": connections.get(role, "")} for role, why in unsafe.items()},
    }
    write_record(path, json_text(content).encode())
    return path


def read_unsafe(run: Path) -> dict[str, str]:
    """Return the reasons why devices of a run could not be made safe, by role, from the files of `write_unsafe`.

    A file that cannot be read gives an entry under its name.
    """
    found: dict[str, str] = {}
    try:
        for path in records(FOLDER):
            if path.name.startswith(f"{run.name}."):
                content = read_kept(path, _FORM)
                if Path(content["run"]).resolve() == run.resolve():
                    found |= {role: device["why"] for role, device in content["unsafe"].items()}
    except (StoreError, OSError) as problem:
        found["a device"] = str(problem)
    return found
