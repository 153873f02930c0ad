"""Panels of curves of a run, as JSON for the script that draws them."""

from __future__ import annotations

import json
from typing import Any

from bench.figures.languages import tr
from bench.station.runs.deviation import DEVIATION
from bench.station.runs.live import LiveRun
from bench.station.runs.series import PULSE_RATE
from bench.web.pages.readings import SET_POINT, label
from bench.web.pages.trends import Trend
from bench.web.shown import FORMS

UNITS_OF_CURVES = ("°C", "°", "pulse/s", "°/s", "A", "V")
TITLES = {
    "°C": "Temperature",
    "pulse/s": "Pulse rate",
    "°": "Angle",
    "°/s": "Rate",
    "A": "Current",
    "V": "Voltage",
}


def panels_of(live: LiveRun, trend: Trend) -> str:
    """Return the curves of a run as JSON: panels by unit, each with its channels; the first three are seen first."""
    units = dict(trend.units)
    units |= dict.fromkeys((live.timeline or {}).get("counted", ()), PULSE_RATE)
    swung = _swung(live)
    panels = []
    for unit in (each for each in UNITS_OF_CURVES if each in units.values()):
        names = [name for name, its in units.items() if its == unit]
        channels = [
            {
                "name": name, "label": _legend(name), "isTarget": name.endswith(SET_POINT),
                "isSwung": name.partition(".")[0] in swung,
            }
            for name in names
        ]  # fmt: skip
        panels.append({"unit": unit, "title": tr(TITLES[unit]), "least": FORMS[unit][1], "channels": channels})
    if trend.expected:
        panels.insert(1 if panels and panels[0]["unit"] == "°C" else 0, _deviations(trend))
    return json.dumps(panels, ensure_ascii=False)


def _deviations(trend: Trend) -> dict[str, Any]:
    """Return the panel of pulse rates minus what is expected of the units."""
    channels = [
        {"name": f"{name}{DEVIATION}", "label": label(name), "isTarget": False, "isSwung": False}
        for name in trend.expected
    ]
    title = tr("Pulse rate minus expectation")
    return {"unit": PULSE_RATE, "title": title, "least": FORMS[PULSE_RATE][1], "zero": True, "channels": channels}


def _swung(live: LiveRun) -> set[str]:
    """Return the roles that the plan oscillates: polled readings of these are too few for a curve."""
    steps = (live.timeline or {}).get("steps", ())
    return {str(step["facts"].get("role")) for step in steps if step["facts"]["verb"] == "oscillate"}


def _legend(name: str) -> str:
    if name.endswith(SET_POINT):
        return tr("{device} set point", device=label(name.removesuffix(SET_POINT)))
    return label(name)
