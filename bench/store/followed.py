"""What guardians have recorded of chambers after their runs: commanded, held, arrived or not."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.store.machine_state import printable

FOLLOWED = "followed.jsonl"


def course_of(run: Path) -> dict[str, str]:
    """The last thing that a guardian has recorded of each device after a run, in words, by role."""
    found: dict[str, str] = {}
    for entry in read_lines(run / FOLLOWED):
        role = printable(str(entry.get("role", "")))
        if role and (words := _in_words(entry)):
            found[role] = printable(words)
    return found


def _in_words(entry: dict[str, Any]) -> str:
    why, at = entry.get("why", ""), str(entry.get("at", ""))[:19]
    air = f", air at {entry['air_c']:.1f} °C" if isinstance(entry.get("air_c"), int | float) else ""
    match entry.get("event"):
        case "commanded" if not entry.get("is_complete"):
            return f"safe set point commanded at {at}; its air is on its way"
        case "commanded":
            return f"safe since {at}: {entry.get('what', '')}"
        case "held" | "reading":
            return f"held at {entry.get('set_point_c')} °C{air} at {at}; its guardian ends that"
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


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """The entries of a file; a line that cannot be read is one without content."""
    try:
        text = path.read_text("utf-8", errors="replace")
    except FileNotFoundError:
        return
    except OSError as problem:
        yield {"unreadable": str(problem)}
        return
    for line in text.splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            entry = {}
        yield entry if isinstance(entry, dict) else {}
