"""Report of a calibration verified on a ramp: what it leaves over temperature, static and dynamic side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown
from bench.figures.plots import Array, Plot, temperature_label
from bench.figures.svg import new_figure, rendered
from bench.methods.ramp.reduction.legs import Leg
from bench.methods.ramp.reduction.verification import LeftCurves
from bench.methods.ramp.shown import FALLING, RISING, thinned
from bench.metrology.results.finding import UnitResult


def left_plots(unit: UnitResult, name: str) -> Iterator[Plot]:
    """Bias that is left at 0 g, static and dynamic, and scale factor; `name` is the prefix of the ids in the page."""
    if not isinstance(unit.detail, LeftCurves):
        return
    of, left = unit.detail.of, unit.detail.left
    panels = [(tr("static"), left.static)] + ([] if of.known.dynamic is None else [(tr("dynamic"), left.dynamic)])
    factor, symbol = scale_shown("K0/left_largest", "g")
    figure = new_figure(3.4)
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for each, (word, curves) in zip(axes, panels, strict=True):
        _draw(each, of.level.legs, curves, factor)
        each.set(xlabel=temperature_label(), title=word)
    axes[0].set_ylabel(f"{tr('K0 + misalignment')} / {symbol}")
    axes[0].legend(fontsize=6.5)
    title = tr("Bias that the calibration leaves on the ramps")
    caption = tr(
        "Converted output at 0 g less gravity, about its mean, which contains the misalignment. Static: by the curves "
        "of the calibration. Dynamic: with its model over temperature and dT/dt. Solid on rising, dashed on falling "
        "temperature."
    )
    yield Plot(title, rendered(figure, f"{name}-left", title), caption)
    factor, symbol = scale_shown("K1/left_largest", "1")
    figure = new_figure(2.7)
    below = figure.subplots()
    _draw(below, of.upright.legs, left.scale, factor)
    below.set(xlabel=temperature_label(), ylabel=f"K1 / {symbol}")
    below.legend(ncols=2, fontsize=6.5)
    title = tr("Scale factor that the calibration leaves on the ramps")
    caption = tr("Relative, about its mean, from the output at 1 g less that at 0 g in the same direction.")
    yield Plot(title, rendered(figure, f"{name}-left-scale", title), caption)


def _draw(axes: Axes, legs: Sequence[Leg], curves: Sequence[Array], factor: float) -> None:
    """Curves of the legs about their common mean."""
    mean = float(np.mean(np.concatenate(curves)))
    axes.axhline(0, color="#444444", linewidth=0.6)
    for leg, curve in zip(legs, curves, strict=True):
        colours, style, word = (RISING, "-", tr("rising")) if leg.name == "up" else (FALLING, "--", tr("falling"))
        axes.plot(
            thinned(leg.temperature_c), thinned((curve - mean) * factor), linestyle=style, linewidth=0.9,
            color=colours[(leg.cycle - 1) % len(colours)],
            label=tr("cycle {number}", number=leg.cycle) + tr(", ") + word,
        )  # fmt: skip
