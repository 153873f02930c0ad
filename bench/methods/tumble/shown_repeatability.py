"""Report of a repeated tumble: its values one after the other, and their scatter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.methods.tumble.reduction.repeatability import UNITS, Repeated, rows
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import CONFIDENCE, UnitResult


def repeated_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plot of the values over the repetitions, and their standard deviations; `name` is the prefix of the ids."""
    found = list(rows(unit.detail))
    if not found:
        return
    yield _plot(found, name)
    yield Sheet(
        tr("Scatter of the values"),
        tr(
            "The interval contains, at {share}, the standard deviation of infinitely many repetitions "
            "(chi-square). Where the scatter of the readings is as large as the standard deviation, the unit repeats "
            "better than this run can show.",
            share=f"{CONFIDENCE:.0%}",
        ),
        (
            (tr("Constant"), ""), (tr("Unit"), ""), (tr("Standard deviation"), ""), (tr("From"), ""), (tr("To"), ""),
            (tr("Of the readings"), ""),
        ),
        tuple(_row(each) for each in found),
    )  # fmt: skip


def _row(found: Repeated) -> tuple[str, ...]:
    factor, unit = scale_shown(f"{found.quantity}/sd", UNITS[found.quantity])
    own = float(np.sqrt(np.mean(found.own**2)))
    return (
        tr(found.quantity), unit, *(f"{value * factor:.3g}" for value in (found.sd, *found.interval, own)),
    )  # fmt: skip


def _plot(found: list[Repeated], name: str) -> Plot:
    figure = new_figure(1.9 * len(found) + 0.6)
    panels = figure.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each in zip(panels, found, strict=True):
        factor, unit = scale_shown(f"{each.quantity}/sd", UNITS[each.quantity])
        shown = (each.values - each.values.mean()) * factor
        axes.axhspan(-each.sd * factor, each.sd * factor, color="#dbeafe", linewidth=0)
        axes.axhline(0, color="#444444", linewidth=0.6)
        axes.errorbar(
            each.repetition, shown, COVERAGE * each.own * factor, fmt="o", markersize=5, elinewidth=0.8, capsize=2.5,
            color="#0b5394",
        )  # fmt: skip
        axes.set(ylabel=f"{tr(each.quantity)} / {unit}")
        axes.set_xticks(each.repetition)
    panels[-1].set(xlabel=tr("repetition"))
    title = tr("Values over the repetitions, less their means")
    caption = tr("Bars: from the scatter of the readings, 95 %. Shaded: one standard deviation to either side.")
    return Plot(title, rendered(figure, f"{name}-repeated", title), caption)
