"""What guardians, and `bench make-safe`, have recorded of chambers after their runs: commanded, held, arrived or not.

Anybody may have written to the file: nothing in it is taken for more than it is.
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
    """An entry about a device: temperatures in °C, None where there are none; texts without what a terminal obeys."""

    role: str
    event: str
    at: str
    why: str
    what: str
    is_complete: bool
    air_c: float | None
    set_point_c: float | None


def followed(run: Path) -> Iterator[Followed | None]:
    """Every entry of a run about a device, in order; None for one that cannot be read."""
    for entry in read_lines(run / FOLLOWED):
        role, event, at, why, what = (_text(entry.get(name)) for name in ("role", "event", "at", "why", "what"))
        if event in _STATES and role:
            numbers = _temperature(entry.get("air_c")), _temperature(entry.get("set_point_c"))
            yield Followed(role, event, at, why, what, entry.get("is_complete") is True, *numbers)
        elif event != "alert":
            yield None


def course_of(run: Path) -> dict[str, str]:
    """The last thing that is on record of each device after a run, in words, by role."""
    return {each.role: words for each in followed(run) if each is not None and (words := _in_words(each))}


def _in_words(entry: Followed) -> str:
    why, at = entry.why, entry.at[:19]
    air = "" if entry.air_c is None else f", air at {entry.air_c:.1f} °C"
    match entry.event:
        case "commanded" if not entry.is_complete:
            return f"safe set point commanded at {at}; its air is on its way"
        case "commanded":
            return f"safe since {at}: {entry.what}"
        case "held" | "reading":
            held = "its set point" if entry.set_point_c is None else f"{entry.set_point_c:g} °C"
            return f"held at {held}{air} at {at}; its guardian ends that"
        case "not_seen":
            return f"held, and could not be looked at at {at}: {why}"
        case "arrived":
            return f"arrived at {at}{air}"
        case "not_arrived":
            return f"NOT ARRIVED at {at}{air}: {why}"
        case "handed_over":
            return f"handed over at {at}: {why}"
        case "ended":
            return f"not followed any more since {at}; whether its air has arrived is not known{f': {why}' * bool(why)}"
        case _:
            return ""


def _text(value: object) -> str:
    return printable(value[:_TEXT_AT_MOST]) if isinstance(value, str) else ""


def _temperature(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) < _HOTTEST_C else None


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """The entries of a file; a line that cannot be read is one without content."""
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
