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
from bench.web.shown import ANY_FORM, FORMS

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
    sent = (live.timeline or {}).get("outputs", {})
    units |= sent
    swung = _swung(live)
    panels = []
    for unit in dict.fromkeys([each for each in UNITS_OF_CURVES if each in units.values()] + list(sent.values())):
        names = [name for name, its in units.items() if its == unit]
        channels = [
            {
                "name": name, "label": _legend(name), "isTarget": name.endswith(SET_POINT),
                "isSwung": name.partition(".")[0] in swung,
            }
            for name in names
        ]  # fmt: skip
        title = tr(TITLES.get(unit, "Output"))
        panels.append({"unit": unit, "title": title, "least": _least(unit), "channels": channels})
    place = 1 if panels and panels[0]["unit"] == "°C" else 0
    panels[place:place] = [_deviations(trend, unit) for unit in dict.fromkeys(trend.expected.values())]
    return json.dumps(panels, ensure_ascii=False)


def _deviations(trend: Trend, unit: str) -> dict[str, Any]:
    """Return the panel of outputs in a unit minus what is expected of the units under test."""
    channels = [
        {"name": f"{name}{DEVIATION}", "label": label(name), "isTarget": False, "isSwung": False}
        for name, its in trend.expected.items()
        if its == unit
    ]
    title = tr("Pulse rate minus expectation" if unit == PULSE_RATE else "Output minus expectation")
    return {"unit": unit, "title": title, "least": _least(unit), "zero": True, "channels": channels}


def _least(unit: str) -> float:
    """Return the least range of a curve in a unit."""
    return FORMS.get(unit, ANY_FORM)[1]


def _swung(live: LiveRun) -> set[str]:
    """Return the roles that the plan oscillates: polled readings of these are too few for a curve."""
    steps = (live.timeline or {}).get("steps", ())
    return {str(step["facts"].get("role")) for step in steps if step["facts"]["verb"] == "oscillate"}


def _legend(name: str) -> str:
    if name.endswith(SET_POINT):
        return tr("{device} set point", device=label(name.removesuffix(SET_POINT)))
    return label(name)
