"""Loops of bias and scale factor in a report: rising less falling temperature at every set point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown, shown
from bench.figures.plots import Plot, temperature_label
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.metrology.results.finding import Finding, UnitResult

LOOPS = ("K0/loop", "K1/loop")
COLOURS = ("#0b5394", "#b45309", "#3f7d20", "#7f1d1d")  # by cycle, then repeated


def loops_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plot and table of the loops; nothing if no set point was reached both ways."""
    found = {quantity: [each for each in unit.findings if each.quantity == quantity] for quantity in LOOPS}
    if not all(found.values()):
        return
    figure = new_figure(2.9)
    for axes, (quantity, loops) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        factor, symbol = scale_shown(quantity, loops[0].unit)
        for cycle in sorted({each.at["cycle"] for each in loops}):
            of_cycle = [each for each in loops if each.at["cycle"] == cycle]
            axes.errorbar(
                *_points(of_cycle, factor), marker="o", markersize=4.0, linestyle="none", elinewidth=0.8, capsize=2.5,
                color=COLOURS[(cycle - 1) % len(COLOURS)], label=tr("cycle {number}", number=cycle),
            )  # fmt: skip
        axes.axhline(0, color="#444444", linewidth=0.6)
        axes.set(xlabel=temperature_label(), ylabel=f"{tr('loop')} / {symbol}", title=quantity.partition("/")[0])
        axes.legend()
    title = tr("Loops of bias and scale factor over temperature")
    caption = tr(
        "The value on rising less that on falling temperature at each set point, both brought to one temperature by "
        "the model. Bars: expanded uncertainty of what does not cancel between the two dwells."
    )
    yield Plot(title, rendered(figure, f"{name}-loops", title), caption)
    yield _table(title, found)


def _points(loops: Sequence[Finding], factor: float) -> tuple[Any, Any, Any]:
    """Temperatures, values and expanded uncertainties (n,)."""
    rows = np.array([(each.at["temperature_c"], each.value * factor, each.expanded * factor) for each in loops])
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _table(title: str, found: dict[str, list[Finding]]) -> Sheet:
    heads = [(tr("cycle"), ""), (tr("set point"), "°C")]
    heads += [(quantity.partition("/")[0], scale_shown(quantity, found[quantity][0].unit)[1]) for quantity in LOOPS]
    rows = tuple(
        (str(first.at["cycle"]), f"{first.at['temperature_set_c']:g}", shown(first), shown(second))
        for first, second in zip(*(found[quantity] for quantity in LOOPS), strict=True)
    )
    return Sheet(title, tr("Rising less falling temperature, with U."), tuple(heads), rows)
