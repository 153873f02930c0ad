"""A plan drawn against time: what each device is told, and when is soaked, asked and counted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoMinorLocator

from bench.config.models import BenchFile
from bench.report.shown import duration, megabytes
from bench.report.svg import new_figure
from bench.report.timeline import output_unit
from bench.sequence.estimate import Estimate, Span
from bench.sequence.measuring import Acquire, Measure, Tare
from bench.sequence.motion import rate_change_s
from bench.sequence.plan import Alternatives, Meanwhile, Node, Nodes, Passes, Plan, leaves, within
from bench.sequence.stimulus import TURN_DEG, Move, Oscillate, Ramp, Rotate, SetOutput
from bench.sequence.talk import Prompt
from bench.sequence.waits import Soak, Wait, WaitUntil

WIDTH_IN = 10.7  # of A4 on its side, between the margins
PANEL_IN, BAR_IN, STRIP_IN, GAP_IN = 1.25, 0.22, 0.2, 0.18
MOST_NUMBERS = 40  # of temperatures beside their line; more cannot be read
PHASES = {"setup": "#e5e7eb", "steps": "#dbeafe", "teardown": "#e5e7eb"}
COLOURS = ("#0b5394", "#b45309", "#4d7c0f", "#7e22ce", "#be185d")
BARS = {"soak": "#f59e0b", "wait": "#9ca3af", "prompt": "#b42318", "measure": "#0e7490"}
ACQUIRE_COLOUR = "#166534"
Points = list[tuple[float, float]]  # time in s, and the value there; a straight line joins them


@dataclass
class _Panel:
    """Lines over time, by role, in one unit; `bands` are swings about zero: from, to, amplitude."""

    label: str
    lines: dict[str, Points] = field(default_factory=dict)
    bands: list[tuple[float, float, float]] = field(default_factory=list)


def plan_figure(plan: Plan, expected: Estimate, bench: BenchFile) -> Figure:
    """The figure: a panel for each thing that occurs, over one time axis."""
    spans = list(_drawn((*plan.setup, *plan.steps, *plan.teardown), {each.step.id: each for each in expected.spans}))
    panels = list(_panels(spans, expected.total_s, bench))
    bars = _bars(spans)
    heights_in = [STRIP_IN, *(PANEL_IN for _ in panels), *([0.12 + BAR_IN * len(bars)] if bars else [])]
    top_in, bottom_in = 0.5, 0.42
    height_in = sum(heights_in) + GAP_IN * (len(heights_in) - 1) + top_in + bottom_in
    figure = new_figure(height_in, width_in=WIDTH_IN, top_in=top_in, bottom_in=bottom_in)
    mean_in = sum(heights_in) / len(heights_in)
    rows = figure.subplots(
        len(heights_in), 1, sharex=True, squeeze=False, height_ratios=heights_in,
        gridspec_kw={"hspace": GAP_IN / mean_in},
    )[:, 0]  # fmt: skip
    unit, unit_s = _time_unit(expected.total_s)
    _draw_phases(rows[0], expected, unit_s)
    for axes, panel in zip(rows[1:], panels, strict=False):
        _draw_panel(axes, panel, unit_s)
    if bars:
        _draw_bars(rows[-1], bars, unit_s)
    for axes in rows[1:]:
        _draw_marks(axes, spans, plan, expected, unit_s)
    rows[-1].set_xlabel(f"time since the run began / {unit}")
    rows[-1].set_xlim(0, max(expected.total_s, 1.0) / unit_s)
    rows[-1].xaxis.set_minor_locator(AutoMinorLocator())
    figure.align_ylabels(list(rows[1:]))
    preset = f", preset {plan.preset}" if plan.preset else ""
    figure.suptitle(
        f"{plan.sequence.title} ({plan.name}{preset}) on {bench.title}: {len(plan)} steps, about "
        f"{duration(expected.total_s)}, {megabytes(expected.size_bytes)}",
        x=0.068, y=1 - 0.12 / height_in, ha="left", va="top", fontsize=10, fontweight="bold",
    )  # fmt: skip
    return figure
