"""Report of ladders of small steps: plots and tables of the steps that the output followed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.methods.threshold.reduction.run import Ladder, by_position
from bench.methods.threshold.reduction.threshold import COUNT_SHARE, PASSING_SHARE, LadderStep
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span

UPWARD: dict[str, Any] = {"color": "#0b5394", "marker": "^"}
DOWNWARD: dict[str, Any] = {"color": "#b45309", "marker": "v", "markerfacecolor": "white"}
RATIO_SHOWN = (-0.3, 1.7)  # a ratio far outside is drawn at the edge; the table has the value


def ladder_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plot and table for each ladder; `name` is the prefix of their ids in the page."""
    if isinstance(unit.detail, tuple):
        for ladder in unit.detail:
            yield _plot(ladder, f"{name}-ladder-{ladder.position_deg:g}")
            yield _sheet(ladder)


def _title(ladder: Ladder) -> str:
    text = "Threshold about {angle}°" if ladder.quantity == "threshold" else "Resolution about {angle}°"
    return tr(text, angle=f"{ladder.position_deg:g}")


def _plot(ladder: Ladder, name: str) -> Plot:
    factor, symbol = scale_shown(ladder.quantity, "g")
    figure = new_figure(3.2)
    axes = figure.subplots()
    for sense, style, label in ((1, UPWARD, tr("upward")), (-1, DOWNWARD, tr("downward"))):
        steps = [step for step in ladder.found.steps if step.input_g * sense > 0]
        _draw_sense(axes, steps, factor, style | {"label": label})
    axes.axhline(PASSING_SHARE, color="#b42318", linewidth=0.8, label=tr("one half"))
    axes.axhline(1, color="#444444", linewidth=0.6)
    if np.isfinite(ladder.found.high_g) and ladder.found.low_g:
        axes.axvspan(ladder.found.low_g * factor, ladder.found.high_g * factor, color="#dddddd", zorder=0)
    sizes = sorted({float(f"{step.size_g * factor:.2g}") for step in ladder.found.steps})
    axes.set(
        xscale="log", ylim=RATIO_SHOWN, xlabel=f"{tr('input step')} / {symbol}", ylabel=tr("output change / expected"),
        title=_title(ladder),
    )  # fmt: skip
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.set_xticks([], minor=True)
    axes.legend(loc="lower right")
    caption = tr(
        "Output change divided by the change expected from the nominal scale factor, over the input step read back "
        "from the head. Bars: expanded uncertainty, 95 %. A step passes at one half or more."
    )
    if np.isfinite(ladder.found.high_g) and ladder.found.low_g:
        caption += " " + tr("The value lies in the grey band, between the largest failed step and the next.")
    return Plot(_title(ladder), rendered(figure, name, _title(ladder)), caption)


def _draw_sense(axes: Axes, steps: list[LadderStep], factor: float, style: dict[str, Any]) -> None:
    """Draw the steps of one sense, by their size."""
    steps = sorted(steps, key=lambda step: step.size_g)
    if steps:
        axes.errorbar(
            [step.size_g * factor for step in steps],
            np.clip([step.ratio for step in steps], *RATIO_SHOWN),
            [COVERAGE * step.u_ratio for step in steps],
            linewidth=0.8, markersize=5, capsize=2.5, **style,
        )  # fmt: skip


def _sheet(ladder: Ladder) -> Sheet:
    factor, symbol = scale_shown(ladder.quantity, "g")
    steps = sorted(ladder.found.steps, key=lambda step: (step.size_g, -step.input_g))
    caption = tr(
        "Means of the repeats. The input step is read back from the head, relative to the line between the "
        "readings at the position before and after it."
    )
    if ladder.found.left_out:
        caption += " " + tr("{count} readings were not used.", count=ladder.found.left_out)
    return Sheet(
        tr("{ladder}: its steps", ladder=_title(ladder)),
        caption,
        (
            (tr("Angle step"), "arcsec"), (tr("Repeats"), ""), (tr("Input step"), symbol),
            (tr("Output change"), symbol), (tr("Change over expected"), "U, 95 %"), (tr("Passes"), ""),
            (tr("Remark"), ""),
        ),
        tuple(_row(ladder, step, factor) for step in steps),
    )  # fmt: skip


def _row(ladder: Ladder, step: LadderStep, factor: float) -> tuple[str, ...]:
    expanded = COVERAGE * step.u_ratio
    digits = decimals(expanded)
    remarks = (
        tr("one count is more than {share} of it", share=f"{COUNT_SHARE:.0%}") if step.too_short else "",
        tr("could be otherwise if repeated") if step.marginal else "",
    )
    return (
        f"{ladder.step_arcsec(step):+.2f}",
        f"{step.repeats}",
        f"{step.input_g * factor:+.2f}",
        f"{round(step.output_g * factor, 2) + 0.0:+.2f}",
        f"{round(step.ratio, digits) + 0.0:.{digits}f} ± {expanded:.{digits}f}",
        tr("yes") if step.passed else tr("no"),
        tr("; ").join(filter(None, remarks)),
    )


def ladders(data: RunData) -> Iterator[Span]:
    """Ladders of small steps, by their positions."""
    for position, steps in by_position(data).items():
        yield Span(tr("about {angle}°", angle=f"{position:g}"), steps[0].begin_s, steps[-1].end_s)
