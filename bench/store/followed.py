"""Record of chambers after their runs, written by guardians and `bench make-safe`: commanded, held, arrived or not.

Any user may have written to the file, so every field is validated.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from bench.store.machine_state import printable
from drivers.schema.bounded import UnfitFileError, read_bounded

FOLLOWED = "followed.jsonl"
LIMIT_BYTES = 16 * 2**20
_TEXT_AT_MOST, _HOTTEST_C = 400, 1e4
_STATES = ("commanded", "held", "reading", "not_seen", "hold_ends", "arrived", "not_arrived", "handed_over", "ended")


class Followed(NamedTuple):
    """Entry about a device: temperatures in °C or None, texts without control characters."""

    role: str
    event: str
    at: str
    why: str
    what: str
    is_complete: bool
    air_c: float | None
    set_point_c: float | None


def followed(run: Path) -> Iterator[Followed | None]:
    """Yield the entries of a run about devices in order, None for each that cannot be read."""
    for entry in read_lines(run / FOLLOWED):
        role, event, at, why, what = (_text(entry.get(name)) for name in ("role", "event", "at", "why", "what"))
        if event in _STATES and role:
            numbers = _temperature(entry.get("air_c")), _temperature(entry.get("set_point_c"))
            yield Followed(role, event, at, why, what, entry.get("is_complete") is True, *numbers)
        elif event != "alert":
            yield None


def _text(value: object) -> str:
    return printable(value[:_TEXT_AT_MOST]) if isinstance(value, str) else ""


def _temperature(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) < _HOTTEST_C else None


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the entries of a file; a line that cannot be read gives an empty one."""
    try:
        path.stat()
        text = read_bounded(path, LIMIT_BYTES).decode("utf-8", errors="replace")
    except FileNotFoundError:
        return
    except (OSError, UnfitFileError) as problem:
        yield {"unreadable": str(problem)}
        return
    for line in text.splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            entry = {}
        yield entry if isinstance(entry, dict) else {}
