"""Plot of a plan over time, for the wall at the bench."""

from __future__ import annotations

import math
import textwrap
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoMinorLocator, MultipleLocator

from bench.config.models import BenchFile
from bench.errors import InputError
from bench.figures.svg import CLEAR, as_document, drawing, new_figure, rendered
from bench.figures.templates import environment_of
from bench.figures.times_and_sizes import duration, megabytes
from bench.files import atomic_file
from bench.report.plan_view.content import Panel, Planned, planned
from bench.report.plan_view.timeline import plan_table
from bench.sequence.document.model import PHASES
from bench.sequence.estimate.estimate import Estimate
from bench.sequence.language.values import as_written
from bench.sequence.plan.plan import Plan

WIDTH_IN, LEFT_IN = 10.7, 1.15  # landscape A4, between the margins
TOP_IN, BOTTOM_IN, GAP_IN = 0.42, 0.42, 0.16
STRIP_IN, PANEL_IN, OUTPUT_IN, BAR_IN = 0.18, 1.25, 0.6, 0.2
TITLE_LINE_IN, TITLE_CHARACTERS = 0.17, 100
LEAST_SPAN = 10.0  # minimum range of a panel, so that a constant value does not fill it with noise in its last digits
MOST_NUMBERS = 40  # values beside a line; more are not legible
LONGEST_NAME = 18  # characters of the name of a row of bars, in the margin
PHASE_COLOURS = {"setup": "#e5e7eb", "steps": "#dbeafe", "teardown": "#e5e7eb"}
LINE_COLOURS = ("#0b5394", "#b45309", "#4d7c0f", "#7e22ce", "#be185d")
BAR_COLOURS = {"prompt": "#b42318", "soak": "#f59e0b", "wait": "#9ca3af", "oscillate": "#a78bfa", "measure": "#0e7490"}
ACQUIRE_COLOUR = "#166534"


def write_picture(path: Path, plan: Plan, expected: Estimate, bench: BenchFile) -> None:
    """Write the picture as FILE.svg, or with a description in words as FILE.html; InputError for any other name."""
    if path.suffix not in (".svg", ".html"):
        raise InputError(f"{path}: a picture is written as .svg or .html")
    with drawing():
        figure = plan_figure(plan, expected, bench)
        text = as_document(figure) if path.suffix == ".svg" else _page(figure, plan, expected, bench)
    with atomic_file(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _page(figure: Figure, plan: Plan, expected: Estimate, bench: BenchFile) -> str:
    title = f"Plan of {plan.sequence.title}"
    return environment_of("bench.report").get_template("plan.html.j2").render(
        title=title,
        facts=[
            ("Sequence", f"{plan.document.path.name}{f', preset {plan.preset}' if plan.preset else ''}"),
            ("Bench", bench.title),
            ("Takes", f"about {duration(expected.total_s)}, {len(plan)} steps"),
            ("Writes", f"about {megabytes(expected.size_bytes)}"),
            *((f"Parameter {name}", as_written(value)) for name, value in plan.parameters.items()),
        ],
        picture=rendered(figure, "plan", title),
        timeline="\n".join(plan_table(plan, expected, bench)),
    )  # fmt: skip


def plan_figure(plan: Plan, expected: Estimate, bench: BenchFile) -> Figure:
    """The figure, to be called within `drawing`: a panel for each kind of quantity, over one time axis."""
    content = planned(plan, expected, bench)
    heights_in = [STRIP_IN, *(OUTPUT_IN if panel.kind == "output" else PANEL_IN for panel in content.panels)]
    if content.bars:
        heights_in.append(BAR_IN * (len(content.bars) + 0.6))
    title = _title(plan, expected, bench)
    top_in = TOP_IN + TITLE_LINE_IN * (len(title) - 1)
    height_in = top_in + sum(heights_in) + GAP_IN * (len(heights_in) - 1) + BOTTOM_IN
    figure = new_figure(height_in, width_in=WIDTH_IN, top_in=top_in, bottom_in=BOTTOM_IN)
    figure.subplots_adjust(left=LEFT_IN / WIDTH_IN)
    gaps = {"hspace": GAP_IN * len(heights_in) / sum(heights_in)}  # relative to the mean height
    strip, *rows = figure.subplots(
        len(heights_in), 1, sharex=True, squeeze=False, height_ratios=heights_in, gridspec_kw=gaps
    )[:, 0]  # fmt: skip
    unit, unit_s = _time_unit(expected.total_s)
    _draw_phases(strip, expected, unit_s)
    for axes, panel in zip(rows, content.panels, strict=False):
        _draw_panel(axes, panel, unit_s)
    if content.bars:
        _draw_bars(rows[-1], content, unit_s)
    for axes in rows:
        _draw_marks(axes, content, unit_s)
    last = figure.axes[-1]
    chosen = "; of alternatives the longer one is shown" if content.chosen else ""
    last.set_xlabel(f"time since the run began / {unit}{chosen}")
    last.set_xlim(0, max(expected.total_s, 1.0) / unit_s)
    last.xaxis.set_minor_locator(AutoMinorLocator())
    figure.text(
        LEFT_IN / WIDTH_IN, 1 - 0.08 / height_in, "\n".join(title), va="top", fontsize=10, fontweight="bold"
    )  # fmt: skip
    return figure


def _title(plan: Plan, expected: Estimate, bench: BenchFile) -> list[str]:
    """Lines of the title: sequence, number of steps, duration and bench, each short enough for the page."""
    preset = f", preset {plan.preset}" if plan.preset else ""
    text = f"{plan.sequence.title} ({plan.name}{preset}): {len(plan)} steps, about {duration(expected.total_s)}"
    return [*textwrap.wrap(text, TITLE_CHARACTERS), *textwrap.wrap(f"on {bench.title}", TITLE_CHARACTERS)]


def _time_unit(total_s: float) -> tuple[str, float]:
    if total_s > 3 * 3600:
        return "h", 3600.0
    return ("min", 60.0) if total_s > 180 else ("s", 1.0)


def _draw_phases(strip: Axes, expected: Estimate, unit_s: float) -> None:
    """Draw blocks with the name and the duration of each phase, if these fit."""
    strip.set_axis_off()
    begin_s = 0.0
    for phase in PHASES:
        width_s = expected.of_phase(phase)
        strip.axvspan(begin_s / unit_s, (begin_s + width_s) / unit_s, color=PHASE_COLOURS[phase], linewidth=0)
        if width_s > 0.04 * expected.total_s:
            text = f"{phase}, {duration(width_s)}" if width_s > 0.12 * expected.total_s else phase
            strip.text((begin_s + width_s / 2) / unit_s, 0.48, text, ha="center", va="center", fontsize=7)
        begin_s += width_s


def _draw_panel(axes: Axes, panel: Panel, unit_s: float) -> None:
    """Draw lines with their names, and their constant values."""
    colours = cycle(LINE_COLOURS)
    for (role, line), colour in zip(panel.lines.items(), colours, strict=False):
        points = np.array(line)
        axes.plot(points[:, 0] / unit_s, points[:, 1], color=colour, label=role)
        if panel.kind == "output":
            axes.fill_between(points[:, 0] / unit_s, points[:, 1], color=colour, alpha=0.15, linewidth=0)
    for begin_s, end_s, far in panel.swings:
        axes.fill_between(
            [begin_s / unit_s, end_s / unit_s], -far, far, color=BAR_COLOURS["oscillate"], alpha=0.6, linewidth=0
        )  # fmt: skip
    axes.margins(y=0.16)
    low, high = axes.get_ylim()
    if panel.kind == "temperature":
        axes.set_ylim(min(low, (low + high - LEAST_SPAN) / 2), max(high, (low + high + LEAST_SPAN) / 2))
        _draw_values(axes, panel, unit_s)
    if panel.kind == "angle" and high - low > 90:
        axes.yaxis.set_major_locator(MultipleLocator(90 * math.ceil((high - low) / 540)))
    axes.set_ylabel(panel.label)
    axes.yaxis.set_label_coords(-0.55 / WIDTH_IN, 0.5)
    if len(panel.lines) > 1:
        axes.legend(loc="lower right", bbox_to_anchor=(1, 0.96), ncols=6, frameon=False, borderpad=0, fontsize=7)
    else:
        axes.set_title("".join(panel.lines), loc="right", fontsize=7, fontweight="normal", color="#555555", pad=1)


def _draw_values(axes: Axes, panel: Panel, unit_s: float) -> None:
    """Write the temperature at the end of each ramp."""
    ends = [end for line in panel.lines.values() for end in line[2:-1:2]]
    for at_s, value in ends if len(ends) <= MOST_NUMBERS else []:
        axes.annotate(
            f"{value:g}", (at_s / unit_s, value), (2, 3.5), textcoords="offset points", fontsize=6.5, color="#444444",
            bbox=CLEAR,
        )  # fmt: skip


def _draw_bars(axes: Axes, content: Planned, unit_s: float) -> None:
    """Draw a row for each kind of step; a very short bar is a hairline."""
    for row, (name, bars) in enumerate(content.bars.items()):
        colour = BAR_COLOURS.get(name, ACQUIRE_COLOUR)
        pieces = [(begin_s / unit_s, (end_s - begin_s) / unit_s) for begin_s, end_s in bars]
        axes.broken_barh(pieces, (row - 0.38, 0.76), color=colour, linewidth=0.4)
    names = [name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…" for name in content.bars]
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(content.bars) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")


def _draw_marks(axes: Axes, content: Planned, unit_s: float) -> None:
    """Mark prompts, and loops with a measured end."""
    for begin_s, _ in content.bars.get("prompt", ()):
        axes.axvline(begin_s / unit_s, color=BAR_COLOURS["prompt"], linewidth=0.7, linestyle=":")
    for begin_s, end_s, count in content.passes:
        axes.axvspan(begin_s / unit_s, end_s / unit_s, facecolor="none", edgecolor="#c7cdd4", hatch="///", linewidth=0)
        if axes is axes.figure.axes[1]:
            axes.annotate(
                f"up to {count} passes more", (begin_s / unit_s, 1), (3, -3), xycoords=("data", "axes fraction"),
                textcoords="offset points", va="top", fontsize=7, bbox={"color": "white", "pad": 1},
            )  # fmt: skip
