"""Record of successful rehearsals and alerts on this computer."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Literal

from bench.clock import wall_utc
from bench.errors import StoreError
from bench.files import append_line
from bench.store.kept_json import TEXT, object_of
from bench.store.manifest_form import instant
from bench.store.user_state import state_folder

TRIED = "tried.jsonl"
What = Literal["rehearsal", "alert"]
_FORM = object_of({"what": TEXT, "key": TEXT, "at": instant}, ("what", "key", "at"))


def note_tried(what: What, key: str) -> None:
    """Record a success, durably. Raises StoreError."""
    line = {"what": what, "key": key, "at": wall_utc().isoformat(timespec="seconds")}
    try:
        append_line(state_folder() / TRIED, json.dumps(line))
    except OSError as problem:
        raise StoreError(f"that the {what} succeeded cannot be recorded ({problem})") from problem


def last_tried(what: What, key: str) -> datetime | None:
    """Return the time of the last success, or None; lines that cannot be read are ignored."""
    try:
        lines = (state_folder() / TRIED).read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found = [entry["at"] for entry in map(_read, lines) if (entry.get("what"), entry.get("key")) == (what, key)]
    return max(map(datetime.fromisoformat, found), default=None)


def _read(line: str) -> dict[str, str]:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return entry if _FORM(entry) == "" else {}
