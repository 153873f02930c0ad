"""Report of a temperature ramp of one unit: plots over temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown
from bench.figures.plots import Array, Plot, temperature_label
from bench.figures.svg import new_figure, rendered
from bench.methods.ramp.reduction.run import LegCurve
from bench.metrology.results.curves import TemperatureModel
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span

MOST_POINTS = 300  # points of a leg; more cannot be distinguished
RISING = ("#0b5394", "#6fa8dc", "#134f5c", "#8bb8a8")  # colours by cycle, then repeated
FALLING = ("#b45309", "#f0a35e", "#7f1d1d", "#d58a94")


def ramp_plots(unit: UnitResult, name: str) -> Iterator[Plot]:
    """Bias of every leg and residuals of its straight line; `name` is the prefix of the ids in the page."""
    if not isinstance(unit.detail, tuple) or not unit.detail:
        return
    curves: tuple[LegCurve, ...] = unit.detail
    factor, symbol = scale_shown("K0", "g")
    figure = new_figure(5.6)
    above, below = figure.subplots(2, 1, height_ratios=[2, 3], gridspec_kw={"hspace": 0.4})
    _draw_legs(above, curves, [curve.output_g * factor for curve in curves])
    for line in unit.models:
        if isinstance(line, TemperatureModel) and line.quantity == "K0":
            _draw_line(above, line, factor)
    residuals = [curve.residual_g * factor for curve in curves]
    below.axhline(0, color="#444444", linewidth=0.6)
    _draw_legs(below, curves, residuals)
    _draw_jumps(below, curves, residuals)
    above.set(ylabel=f"{tr('K0 + misalignment')} / {symbol}", title=tr("Output at 0 g"), xlabel=temperature_label())
    residuals_of = tr("Residuals of the {curve}", curve=tr("straight line"))
    below.set(ylabel=f"{tr('residual')} / {symbol}", title=residuals_of, xlabel=temperature_label())
    below.legend(ncols=2)
    title = tr("Bias K0 on the ramps, over temperature")
    caption = tr(
        "Above: the output at 0 g less gravity at the angle of the head, that is, the bias and the misalignment of "
        "the input "
        "axis, which is constant; the thin black line is its straight-line fit. Below: its residuals, solid on "
        "rising, dashed on "
        "falling temperature."
    )
    if any(curve.jumps_c for curve in curves):
        caption += " " + tr("Crosses: jumps.")
    yield Plot(title, rendered(figure, f"{name}-ramp", title), caption)


def _draw_legs(axes: Axes, curves: Sequence[LegCurve], values: Sequence[Array]) -> None:
    for curve, of_leg in zip(curves, values, strict=True):
        colours, style, word = (RISING, "-", tr("rising")) if curve.rising else (FALLING, "--", tr("falling"))
        temperature_c, shown = thinned(curve.temperature_c), thinned(of_leg)
        colour, label = (
            colours[(curve.cycle - 1) % len(colours)],
            tr("cycle {number}", number=curve.cycle) + tr(", ") + word,
        )
        axes.plot(temperature_c, shown, color=colour, linestyle=style, linewidth=0.9, label=label)


def _draw_line(axes: Axes, line: TemperatureModel, factor: float) -> None:
    ends_c = np.array(line.valid_c)
    axes.plot(ends_c, line.at(ends_c) * factor, color="#222222", linewidth=0.7, label=tr("straight line"))


def _draw_jumps(axes: Axes, curves: Sequence[LegCurve], residuals: Sequence[Array]) -> None:
    """Draw each jump at its temperature, at the residual of the nearest sample."""
    found = [
        (at_c, of_leg[int(np.argmin(np.abs(curve.temperature_c - at_c)))])
        for curve, of_leg in zip(curves, residuals, strict=True)
        for at_c in curve.jumps_c
    ]
    if found:
        axes.plot(
            *zip(*found, strict=True), "x", color="#b42318", markersize=9, markeredgewidth=2, label=tr("jump"), zorder=3
        )


def thinned(values: Array, most: int = MOST_POINTS) -> Array:
    """Means of consecutive values (n,), grouped so that no more than `most` are left."""
    together = -(-len(values) // most)
    if together <= 1:
        return values
    starts = np.arange(0, len(values), together)
    return np.asarray(np.add.reduceat(values, starts) / np.diff([*starts, len(values)]))


def legs(data: RunData) -> Iterator[Span]:
    """Legs of temperature ramps, an acquisition each, numbered from 1."""
    for number, leg in enumerate(data.acquisitions, start=1):
        yield Span(tr("leg {number}", number=number), leg.begin_s, leg.end_s)
