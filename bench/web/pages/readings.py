"""Readings on a page: each with its set point, its band, the last hour and its quality."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from bench.figures.languages import tr
from bench.figures.sayings import plain
from bench.figures.times_and_sizes import duration
from bench.station.runs.live import LiveRun
from bench.station.runs.series import PULSE_RATE
from bench.web.pages.drawn import sparkline
from bench.web.pages.trends import HOUR_S, Trend
from bench.web.shown import ANY_FORM, FORMS, name_in_words, number

SET_POINT, PROCESS_VALUE = ".set_point", ".process_value"
OLD_S = 10.0  # an age worth showing, in s of real time


class Row(NamedTuple):
    """Reading as it is shown. `why` is given if it is not valid; then the value is struck out."""

    name: str
    label: str
    value: str
    unit: str
    target: str
    band: str
    spark: str
    age: str
    why: str


def rows(live: LiveRun, planned: Mapping[str, Any], trend: Trend) -> list[Row]:
    """Return the readings of a run: temperatures first, then in the order of the bench, outputs last."""
    readings = live.status.get("readings", {})
    shown = [(name, found) for name, found in readings.items() if not name.endswith(SET_POINT)]
    shown.sort(key=lambda each: trend.units.get(each[0]) != "°C")
    return [_row(live, name, found, planned, trend) for name, found in shown] + list(_outputs(live, trend))


def _row(live: LiveRun, name: str, found: Mapping[str, Any], planned: Mapping[str, Any], trend: Trend) -> Row:
    buckets = trend.hours.get(name, [])
    unit = trend.units.get(name) or str(found.get("unit") or "")
    form, least = FORMS.get(unit, ANY_FORM)
    value = found.get("value")
    if value is None and buckets:
        value = buckets[-1].mean
    why = (
        ""
        if found.get("quality") == "valid"
        else f"{tr(str(found.get('quality')))}: {plain(str(found.get('why', '')))}"
    )
    age_s = float(found.get("age_s") or 0.0)
    is_old = age_s > OLD_S * live.speed
    return Row(
        name, label(name), number(value, form=form) if value is not None else "–", unit,
        _target(live, name, planned, form), _band(live, name, planned),
        sparkline(buckets, trend.until_s, HOUR_S, least), tr("{age} old", age=duration(age_s)) if is_old else "", why,
    )  # fmt: skip


def _outputs(live: LiveRun, trend: Trend) -> Iterator[Row]:
    for name, unit in (live.timeline or {}).get("outputs", {}).items():
        found, form = trend.outputs.get(name), FORMS.get(unit, ANY_FORM)[0]
        text = number(found.mean, form=form) if found is not None else "–"
        none = tr("not counting" if unit == PULSE_RATE else "not sending")
        yield Row(name, label(name), text, unit, "", "" if found is not None else none, "", "", "")


def label(name: str) -> str:
    """Return the name of a reading in words; that of a device alone for its process value."""
    device, _, channel = name.removesuffix(PROCESS_VALUE).partition(".")
    return " ".join(name_in_words(word) for word in (device, channel.rpartition(".")[2]) if word)


def _target(live: LiveRun, name: str, planned: Mapping[str, Any], form: str) -> str:
    """Return the set point of a reading; "" if it has none."""
    device, _, channel = name.partition(".")
    set_point = live.status.get("readings", {}).get(f"{device}{SET_POINT}", {})
    if name.endswith(PROCESS_VALUE) and set_point.get("value") is not None:
        return number(set_point["value"], form=form)
    role = planned.get("facts", {}).get("role")
    wanted: float | None = None
    if channel == "angle":
        wanted = planned.get("angles_deg", {}).get(device)
    elif channel in ("voltage", "current"):
        wanted = _level(live, device, channel, planned)
    elif role == name and planned.get("facts", {}).get("verb") == "soak":
        wanted = planned.get("set_point_c")
    return number(wanted, form=form) if wanted is not None else ""


def _level(live: LiveRun, device: str, channel: str, planned: Mapping[str, Any]) -> float | None:
    """Return the level of an output: a voltage of a supply or a current of a source, as the plan has it."""
    steps = (live.timeline or {}).get("steps", ())
    key = "voltage_v" if channel == "voltage" else "current_a"
    is_its = any(step["facts"].get("role") == device and key in step["facts"] for step in steps)
    found = planned.get("outputs", {}).get(device) if is_its else None
    return float(found) if found is not None else None


def _band(live: LiveRun, name: str, planned: Mapping[str, Any]) -> str:
    """Return the range of a soak or the permitted range of a reading; "" if it has none."""
    facts = planned.get("facts", {})
    if facts.get("role") == name and (stable := facts.get("until_stable")):
        return tr("range ≤ {band}", band=number(stable["band_c"]))
    if (limits := (live.timeline or {}).get("limits", {}).get(name)) is not None:
        return f"{number(limits[0])} … {number(limits[1])}"
    return ""
