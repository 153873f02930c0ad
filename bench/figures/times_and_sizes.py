"""Display of durations, instants and file sizes."""

from __future__ import annotations

import datetime as dt
from zoneinfo import ZoneInfo

from bench.figures.languages import tr


def duration(seconds: float) -> str:
    """A duration in usual form: "45 s", "12 min", "32 h 51 min"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


def instant(text: str | None, zone: str) -> str:
    """An instant in ISO 8601 by the clock of the laboratory, with its offset from UTC."""
    if text is None:
        return tr("not recorded")
    there = dt.datetime.fromisoformat(text).astimezone(ZoneInfo(zone))
    return (
        f"{there:%Y-%m-%d %H:%M:%S} UTC{_offset(there)} ({zone})" if zone != "UTC" else f"{there:%Y-%m-%d %H:%M:%S} UTC"
    )


def _offset(there: dt.datetime) -> str:
    """Offset from UTC: "+08:00"."""
    return f"{there:%z}"[:3] + ":" + f"{there:%z}"[3:5]


def megabytes(size_bytes: int) -> str:
    """A size with two digits: "12 MB", "0.037 MB"."""
    return f"{float(f'{size_bytes / 1e6:.2g}'):g} MB"
