"""Numbers, readings and instants as they are shown on pages."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

from bench.figures.languages import tr
from bench.station.runs.series import PULSE_RATE
from drivers.can.sent_frames import CODE

# Digits after the point by unit, so that no number changes its width, and the least range of a curve.
FORMS: Mapping[str, tuple[str, float]] = {
    "°C": (".2f", 1.0), "V": (".3f", 0.1), "A": (".4f", 0.01), "°": (".3f", 1.0), "°/s": (".3f", 1.0),
    PULSE_RATE: (".2f", 10.0), CODE: (".1f", 10.0), "%": (".1f", 5.0), "hPa": (".1f", 5.0),
}  # fmt: skip
ANY_FORM = (".6g", 0.0)


def reading(found: Mapping[str, Any]) -> str:
    """Return a reading of a status with its unit; its quality if it has no value."""
    value, unit = found.get("value"), str(found.get("unit", ""))
    return (
        number(value, unit, FORMS.get(unit, ANY_FORM)[0])
        if value is not None
        else tr(str(found.get("quality", "not read")))
    )


def name_in_words(name: str) -> str:
    """Return the name of a device, a channel or a limit in words; the rate of an axis is no pulse rate."""
    return tr("turning rate" if name == "rate" else name.replace("_", " "))


def number(value: float | None, unit: str = "", form: str = ".6g") -> str:
    """Return a number with a true minus sign and its unit; "?" for an unknown one."""
    if value is None:
        return f"? {unit}".strip()
    text = f"{value:z{form}}" if form[-1:] in "fe" else f"{value:{form}}"
    text = text.replace("-", "−")
    return f"{text}{unit}" if unit == "°" else f"{text} {unit}".strip()


def clock_time(instant: datetime | None, zone: str, now: datetime) -> str:
    """Return an instant as a technician reads it from the clock: "14:02", "06:40 tomorrow", "2026-02-03 06:40"."""
    if instant is None:
        return tr("unknown")
    there, today = instant.astimezone(ZoneInfo(zone)), now.astimezone(ZoneInfo(zone)).date()
    days, time = (there.date() - today).days, f"{there:%H:%M}"
    if days == 1:
        return tr("{time} tomorrow", time=time)
    if days == -1:
        return tr("{time} yesterday", time=time)
    return time if days == 0 else f"{there:%Y-%m-%d %H:%M}"
