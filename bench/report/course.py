"""The course of a run: its temperatures over time, its phases, and when it measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bench.analysis.ladder import by_position
from bench.analysis.rundata import RunData
from bench.report.languages import tr
from bench.report.plots import Plot
from bench.report.stored import StoredRun
from bench.report.svg import new_figure, rendered
from bench.store.reader import Event, Series

Array = NDArray[np.float64]

BINS = 1000  # over the width of the page; more cannot be told apart
MOST_NUMBERS = 60  # of dwells; more cannot be read
CHARACTER = 0.0095  # of the width of the strip, in which its names are written
FIRST_WIDE = "\u2e80"  # Chinese characters are twice as wide as others
INCIDENTS = ("fault", "problem", "operator")
PHASES = {"steps": "#dbeafe", "": "white"}  # "" is after everything was made safe; others are grey
CHAMBER: dict[str, tuple[str, dict[str, Any]]] = {
    "set_point": ("set point", {"color": "#111111", "linestyle": (0, (4, 2)), "linewidth": 0.8}),
    "process_value": ("air", {"color": "#7aa6d6", "linewidth": 0.9}),
}
COLOURS = ("#b45309", "#4d7c0f", "#7e22ce", "#be185d")


@dataclass(frozen=True)
class Span:
    """A part of the run from `begin_s` to `end_s` of bench time."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Course:
    """What the journal says of when things happened; `incident_s` is when the run left its plan.

    `dwells` are the legs where it counted on ramps, and the acquisitions where each is at an input level.
    """

    began_s: float
    ended_s: float
    phases: tuple[Span, ...]
    dwells: tuple[Span, ...]
    acquisitions: tuple[Span, ...]
    incident_s: float | None


def envelope(at_s: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """A series (n,) as the smallest and the largest value of each of `bins` equal times; a gap in time is a NaN.

    What is narrower than a bin keeps its height. A series that is short enough is given back as it is.
    """
    if len(at_s) <= 2 * bins:
        return at_s, values
    edges_s = np.linspace(at_s[0], at_s[-1], bins + 1)
    starts = np.searchsorted(at_s, edges_s[:-1])
    filled = np.diff(starts, append=len(at_s)) > 0
    extremes = np.full((bins, 2), np.nan)
    extremes[filled, 0] = np.minimum.reduceat(values, starts[filled])
    extremes[filled, 1] = np.maximum.reduceat(values, starts[filled])
    middle_s = (edges_s[:-1] + edges_s[1:]) / 2
    return np.repeat(middle_s, 2), extremes.ravel()


def course_of(run: StoredRun, data: Sequence[RunData]) -> Course:
    """The course of a run, whatever state it is in; `data` is what its results are made of."""
    events = list(run.reader.events())
    began_s, ended_s = run.reader.span_s()
    begins: dict[str, float] = {}
    for event in events:
        if event.kind in ("step_begins", "made_safe"):
            begins.setdefault(_phase(event), event.at_s)
    edges_s = [*begins.values(), ended_s]
    spans = {part.label: _legs for part in run.counted_at("ramps")}
    spans |= {part.label: _each for part in (*run.counted_at("levels"), *run.counted_at("table"))}
    spans |= {part.label: _ladders for part in run.counted_at("steps")}
    return Course(
        began_s=began_s,
        ended_s=ended_s,
        phases=tuple(map(Span, begins, edges_s[:-1], edges_s[1:])),
        dwells=tuple(span for part in data for span in spans.get(part.label, _dwells)(part)),
        acquisitions=tuple(Span(each.step, each.begin_s, each.end_s) for part in data for each in part.acquisitions),
        incident_s=next((event.at_s for event in events if event.kind in INCIDENTS), None),
    )


def _dwells(data: RunData) -> Iterator[Span]:
    """The groups of acquisitions, numbered as in the results."""
    for number, members in enumerate(data.groups().values()):
        yield Span(str(number), members[0].begin_s, members[-1].end_s)


def _legs(data: RunData) -> Iterator[Span]:
    """The legs of temperature ramps, an acquisition each, numbered from 1."""
    for number, leg in enumerate(data.acquisitions, start=1):
        yield Span(tr("leg {number}", number=number), leg.begin_s, leg.end_s)


def _each(data: RunData) -> Iterator[Span]:
    """The acquisitions, numbered from 1."""
    for number, acquisition in enumerate(data.acquisitions, start=1):
        yield Span(str(number), acquisition.begin_s, acquisition.end_s)


def _ladders(data: RunData) -> Iterator[Span]:
    """The ladders of small steps, by their positions."""
    for position, steps in by_position(data).items():
        yield Span(tr("about {angle}°", angle=f"{position:g}"), steps[0].begin_s, steps[-1].end_s)


def _phase(event: Event) -> str:
    """What a strip over the run calls the phase that an event is in; a wait before the first measurement warms up."""
    phase, _, step = event.step.partition("/")
    return "warm-up" if phase == "setup" and step.startswith("wait") else phase


def course_plot(run: StoredRun, course: Course) -> Plot | None:
    """The temperatures over the time of the run; None when none was recorded."""
    lines = [line for line in _lines(run) if len(line.series.at_s)]
    if not lines:
        return None
    unit, unit_s = ("h", 3600.0) if course.ended_s - course.began_s > 2 * 3600 else ("min", 60.0)
    figure = new_figure(3.5, top_in=0.07, bottom_in=0.67)
    strip, axes = figure.subplots(2, 1, sharex=True, height_ratios=[1, 10], gridspec_kw={"hspace": 0.05})
    for line in lines:
        at_s, values = envelope(line.series.at_s, line.series.values)
        axes.plot((at_s - course.began_s) / unit_s, values, label=line.name, **line.style)
    _draw_phases(strip, course, unit_s)
    _draw_measuring(axes, course, unit_s)
    axes.set(xlabel=f"{tr('time since the run began')} / {unit}", ylabel=tr("temperature / °C"))
    axes.set_xlim(0, (course.ended_s - course.began_s) / unit_s)
    figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=6)
    title = tr("Course of the run")
    caption = tr(
        "On top the phases of the run, and by their numbers the dwells, or the legs of its ramps. Shaded: these while "
        "they were measured; the ticks at the lower edge are the single acquisitions."
    )
    return Plot(title, rendered(figure, "course", title), caption)


@dataclass(frozen=True)
class _Line:
    name: str
    series: Series
    style: dict[str, Any]


def _lines(run: StoredRun) -> Iterator[_Line]:
    """Set points behind the air of the chambers that the run used, and that behind the units."""
    chambers = run.bench.with_capability("thermal_chamber")
    for role in [role for role in chambers if role in run.sequence.needs] or chambers:
        for channel, unit in sorted(run.bench.devices[role].channels.items(), reverse=True):
            if unit == "°C":
                name, style = CHAMBER.get(channel, (channel.replace("_", " "), {}))
                yield _Line(f"{role}{tr(': ')}{tr(name)}", run.reader.series(f"{role}.{channel}"), style)
    thermometers = dict.fromkeys(run.bench.places[place].temperature for place in run.serials)
    for name, colour in zip(thermometers, cycle(COLOURS), strict=False):
        yield _Line(name.replace("_", " "), run.reader.series(name), {"color": colour})


def _draw_phases(strip: Axes, course: Course, unit_s: float) -> None:
    """Blocks with their names where these fit, above them the numbers of the dwells."""
    strip.set_axis_off()
    total_s = course.ended_s - course.began_s
    for phase in course.phases:
        begin, width = (phase.begin_s - course.began_s) / unit_s, (phase.end_s - phase.begin_s) / unit_s
        strip.axvspan(begin, begin + width, ymax=0.45, color=PHASES.get(phase.name, "#e5e7eb"), linewidth=0)
        if phase.end_s - phase.begin_s > 0.06 * total_s and phase.name != "steps":
            strip.text(begin + width / 2, 0.22, tr(phase.name), ha="center", va="center", fontsize=6)
    step = 1 + len(course.dwells) // MOST_NUMBERS
    free_from_s = course.began_s
    for dwell in sorted(course.dwells[::step], key=lambda one: one.begin_s):
        middle_s = (dwell.begin_s + dwell.end_s) / 2
        half_s = 0.5 * CHARACTER * total_s * sum(1 + (character >= FIRST_WIDE) for character in dwell.name)
        if middle_s - half_s >= free_from_s:
            strip.text((middle_s - course.began_s) / unit_s, 0.6, dwell.name, ha="center", va="bottom", fontsize=6.5)
            free_from_s = middle_s + half_s


def _draw_measuring(axes: Axes, course: Course, unit_s: float) -> None:
    """Dwells, acquisitions, and when the run left its plan."""
    for dwell in course.dwells:
        begin, end = ((at_s - course.began_s) / unit_s for at_s in (dwell.begin_s, dwell.end_s))
        axes.axvspan(begin, end, color="#93c5fd", alpha=0.5, linewidth=0.3)
    ticks = [((each.begin_s + each.end_s) / 2 - course.began_s) / unit_s for each in course.acquisitions]
    axes.plot(ticks, [0.015] * len(ticks), "|", color="#333333", markersize=5, transform=axes.get_xaxis_transform())
    if course.incident_s is not None:
        at = (course.incident_s - course.began_s) / unit_s
        axes.axvline(at, color="#b42318", linestyle=":", label=tr("the run left its plan"))
