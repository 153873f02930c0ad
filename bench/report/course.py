"""Time history of a run: its temperatures, its phases, and its measurements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.plots import Plot, TimeOfRun
from bench.figures.svg import new_figure, rendered
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span, spans_of
from bench.reduce.stored_run import StoredRun
from bench.sequence.method import known_methods
from bench.store.reader import Event, Series

BINS = 1000  # over the width of the page; more cannot be distinguished
CHARACTER = 0.0095  # width of a character of a name, relative to that of the strip
MOST_INSIDE = 0.6  # half a name stays within this share of the strip; the margin has room for the rest
FIRST_WIDE = "\u2e80"  # Chinese characters are twice as wide as others
TICK = (0.0, 0.028, np.nan)  # of an acquisition: from the lower edge, relative to the height
INCIDENTS = ("fault", "problem", "operator", "end_requested")
PHASES = {"steps": "#dbeafe", "": "white"}  # "" is the time after making safe; others are grey
CHAMBER: dict[str, tuple[str, dict[str, Any]]] = {
    "set_point": ("set point", {"color": "#111111", "linestyle": (0, (4, 2)), "linewidth": 0.8}),
    "process_value": ("air", {"color": "#7aa6d6", "linewidth": 0.9}),
}
COLOURS = ("#b45309", "#4d7c0f", "#7e22ce", "#be185d")


@dataclass(frozen=True)
class Course:
    """Times of events by the journal; `incident_s` is the time at which the run deviated from its plan.

    `dwells` are the parts that the report names, or acquisitions without a name in it.
    """

    began_s: float
    ended_s: float
    phases: tuple[Span, ...]
    dwells: tuple[Span, ...]
    acquisitions: tuple[Span, ...]
    incident_s: float | None


def course_of(run: StoredRun, data: Sequence[RunData]) -> Course:
    """Time history of a run, whatever its state; `data` are the acquisitions of its results."""
    began_s, ended_s = run.reader.span_s()
    begins: dict[str, float] = {}
    for event in run.reader.events("step_begins", "made_safe"):
        begins.setdefault(_phase(event), event.at_s)
    edges_s = [*begins.values(), ended_s]
    entries = {label: entry for entry in reversed(run.sequence.results) for label in entry.labels}
    return Course(
        began_s=began_s,
        ended_s=ended_s,
        phases=tuple(map(Span, begins, edges_s[:-1], edges_s[1:])),
        dwells=tuple(
            span
            for part in data
            for span in spans_of(part, entries[part.label], known_methods()[entries[part.label].method])
        ),
        acquisitions=tuple(Span(each.step, each.begin_s, each.end_s) for part in data for each in part.acquisitions),
        incident_s=next((event.at_s for event in run.reader.events(*INCIDENTS)), None),
    )


def _phase(event: Event) -> str:
    """Name in the strip of the phase of an event; a wait before the first measurement is a warm-up."""
    phase, _, step = event.step.partition("/")
    return "warm-up" if phase == "setup" and step.startswith("wait") else phase


def course_plot(run: StoredRun, course: Course) -> Plot | None:
    """Plot of the temperatures over the time of the run; None if none was recorded."""
    lines = [line for line in _lines(run) if len(line.series.at_s)]
    if not lines:
        return None
    over_run = TimeOfRun(course.began_s, course.ended_s)
    _, unit_s = over_run.unit
    figure = new_figure(3.5, top_in=0.07, bottom_in=0.67)
    strip, axes = figure.subplots(2, 1, sharex=True, height_ratios=[1, 10], gridspec_kw={"hspace": 0.05})
    for line in lines:
        axes.plot(over_run.at(line.series.at_s), line.series.values, label=line.name, **line.style)
    _draw_phases(strip, course, unit_s)
    _draw_measuring(axes, course, unit_s)
    axes.set(ylabel=tr("temperature / °C"))
    over_run.finish(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=6)
    title = tr("Course of the run")
    caption = tr(
        "Top: the phases of the run and its measurements, by their numbers or names in the report; "
        "labels that would overlap are omitted. Shaded: periods of measurement; the ticks at the lower edge "
        "mark the single acquisitions."
    )
    return Plot(title, rendered(figure, "course", title), caption)


@dataclass(frozen=True)
class _Line:
    name: str
    series: Series
    style: dict[str, Any]


def _lines(run: StoredRun) -> Iterator[_Line]:
    """Set points, behind the air of the chambers that the run used, behind the temperatures of the units."""
    chambers = run.bench.with_capability("thermal_chamber")
    for role in [role for role in chambers if role in run.sequence.needs] or chambers:
        for channel, unit in sorted(run.bench.devices[role].channels.items(), reverse=True):
            if unit == "°C":
                name, style = CHAMBER.get(channel, (channel.replace("_", " "), {}))
                yield _Line(f"{role}{tr(': ')}{tr(name)}", run.reader.envelope(f"{role}.{channel}", BINS), style)
    thermometers = dict.fromkeys(run.bench.places[place].temperature for place in run.serials)
    for name, colour in zip(thermometers, cycle(COLOURS), strict=False):
        yield _Line(tr(name.replace("_", " ")), run.reader.envelope(name, BINS), {"color": colour})


def _draw_phases(strip: Axes, course: Course, unit_s: float) -> None:
    """Draw blocks with their names if these fit, above them those of the dwells."""
    strip.set_axis_off()
    total_s = course.ended_s - course.began_s
    for phase in course.phases:
        begin, width = (phase.begin_s - course.began_s) / unit_s, (phase.end_s - phase.begin_s) / unit_s
        strip.axvspan(begin, begin + width, ymax=0.45, color=PHASES.get(phase.name, "#e5e7eb"), linewidth=0)
        if phase.end_s - phase.begin_s > 0.06 * total_s and phase.name != "steps":
            strip.text(begin + width / 2, 0.22, tr(phase.name), ha="center", va="center", fontsize=6)
    for name, middle_s in _legible(course):
        strip.text((middle_s - course.began_s) / unit_s, 0.6, name, ha="center", va="bottom", fontsize=6.5)


def _legible(course: Course) -> Iterator[tuple[str, float]]:
    """Names of the dwells with their mid-times; those that would overlap an earlier name are left out."""
    total_s = course.ended_s - course.began_s
    written: list[tuple[float, float]] = []  # middle and half of the width
    for dwell in course.dwells:
        characters = 1 + sum(1 + (character >= FIRST_WIDE) for character in dwell.name)  # one character between names
        half_s = 0.5 * CHARACTER * total_s * characters
        edge_s = MOST_INSIDE * half_s
        inside_s = max(course.began_s + edge_s, min((dwell.begin_s + dwell.end_s) / 2, course.ended_s - edge_s))
        free = all(abs(inside_s - at_s) >= half_s + other_s for at_s, other_s in written)
        if dwell.name and free:
            written.append((inside_s, half_s))
            yield dwell.name, inside_s


def _draw_measuring(axes: Axes, course: Course, unit_s: float) -> None:
    """Draw dwells, acquisitions, and the time at which the run deviated from its plan."""
    for dwell in course.dwells:
        begin, end = ((at_s - course.began_s) / unit_s for at_s in (dwell.begin_s, dwell.end_s))
        axes.axvspan(begin, end, color="#93c5fd", alpha=0.5, linewidth=0.3)
    ticks = [((each.begin_s + each.end_s) / 2 - course.began_s) / unit_s for each in course.acquisitions]
    one_line = np.repeat(ticks, len(TICK)), np.tile(TICK, len(ticks))  # markers would be an element each
    axes.plot(*one_line, color="#333333", linewidth=1, transform=axes.get_xaxis_transform())
    if course.incident_s is not None:
        at = (course.incident_s - course.began_s) / unit_s
        axes.axvline(at, color="#b42318", linestyle=":", label=tr("the run deviated from its plan"))
