"""Plots of the results of one unit over temperature."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown
from bench.figures.svg import CLEAR, new_figure, rendered
from bench.figures.words import quantity_of
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.curves import TemperatureModel
from bench.metrology.results.finding import UnitResult

Array = NDArray[np.float64]

MARKER_PT = 5.0
MOST_NUMBERS = 40  # dwells with a number in one plot; more are not legible
RISING: dict[str, Any] = {"marker": "^", "color": "#0b5394"}
FALLING: dict[str, Any] = {"marker": "v", "color": "#b45309", "markerfacecolor": "white"}
LINES: tuple[dict[str, Any], ...] = ({"color": "#222222"}, {"color": "#777777", "linestyle": (0, (5, 3))})


@dataclass(frozen=True)
class Plot:
    """A figure of the page."""

    title: str
    svg: Markup
    caption: str


@dataclass(frozen=True)
class TimeOfRun:
    """Time axis common to all plots of a run from `began_s` to `ended_s` of bench time."""

    began_s: float
    ended_s: float

    @property
    def unit(self) -> tuple[str, float]:
        """Unit of the axis, and its seconds."""
        return ("h", 3600.0) if self.ended_s - self.began_s > 2 * 3600 else ("min", 60.0)

    def at(self, bench_s: Array) -> Array:
        """Positions of bench times (n,) on the axis."""
        return (bench_s - self.began_s) / self.unit[1]

    def finish(self, axes: Axes) -> None:
        """Label the axis, and set its limits to the whole run."""
        unit, unit_s = self.unit
        axes.set_xlabel(f"{tr('time since the run began')} / {unit}")
        axes.set_xlim(0, (self.ended_s - self.began_s) / unit_s)


@dataclass(frozen=True)
class Points:
    """One quantity at the dwells in run order, in displayed units; all (n,).

    `expanded` is the whole expanded uncertainty, `own` its part not common to all dwells, k = 2.
    """

    dwell: NDArray[np.int64]
    temperature_c: Array
    rising: NDArray[np.bool_]
    values: Array
    expanded: Array
    own: Array


@dataclass(frozen=True)
class Curve:
    """A model in displayed units: `at` returns its values at temperatures."""

    degree: int
    dof: int
    valid_c: tuple[float, float]
    at: Callable[[Array], Array]

    @property
    def name(self) -> str:
        """Name for a legend."""
        if self.degree == 1:
            return tr("straight line")
        return tr("model of degree {degree}", degree=self.degree)


@dataclass(frozen=True)
class Scale:
    """Conversion of numbers to displayed ones: (number - zero) · factor, in `unit`."""

    factor: float
    unit: str
    zero: float = 0.0

    def points(self, unit: UnitResult, quantity: str) -> Points | None:
        """A quantity at the dwells of a unit; None if there is none."""
        found = [finding for finding in unit.findings if finding.quantity == quantity and "dwell" in finding.at]
        if not found:
            return None
        own = [math.fsum(line.u**2 for line in finding.budget if line.shared is None) for finding in found]
        return Points(
            dwell=np.array([finding.at["dwell"] for finding in found]),
            temperature_c=np.array([finding.at["temperature_c"] for finding in found]),
            rising=np.array([finding.at["leg"] == "up" for finding in found]),
            values=(np.array([finding.value for finding in found]) - self.zero) * self.factor,
            expanded=np.array([finding.expanded for finding in found]) * abs(self.factor),
            own=COVERAGE * np.sqrt(own) * abs(self.factor),
        )

    def curves(self, unit: UnitResult, quantity: str) -> list[Curve]:
        """Models of a quantity, the best first."""
        return [
            self._curve(model)
            for model in unit.models
            if isinstance(model, TemperatureModel) and model.quantity == quantity
        ]

    def _curve(self, model: TemperatureModel) -> Curve:
        def at(temperature_c: Array) -> Array:
            return np.asarray((model.at(temperature_c) - self.zero) * self.factor)

        return Curve(len(model.coefficients) - 1, model.dof, model.valid_c, at)


def unit_plots(unit: UnitResult, name: str) -> Iterator[Plot]:
    """Plots of a unit with two dwells or more; `name` is the prefix of their ids in the page."""
    as_shown = Scale(*scale_shown("K0", "g"))
    bias = as_shown.points(unit, "K0")
    if bias is None or len(bias.values) < 2:
        return
    curves = as_shown.curves(unit, "K0")
    yield _over_temperature(tr("Bias K0"), f"{name}-bias", f"K0 / {as_shown.unit}", as_shown.unit, bias, curves)
    centre, at_c, symbol = _middle(unit, "K1")
    relative = Scale(1e6 / centre, "ppm", centre)
    scale_factor, of_scale = relative.points(unit, "K1"), relative.curves(unit, "K1")
    if curves and curves[0].dof and 0 < bias.rising.sum() < len(bias.rising):
        panels = [("K0", as_shown.unit, bias, curves[0])]
        if scale_factor is not None and of_scale:
            panels.append(("K1", "ppm", scale_factor, of_scale[0]))
        yield _loops(f"{name}-loop", panels)
    if scale_factor is not None:
        value = f"{centre:.7g} {symbol}"
        title = tr("Scale factor K1 relative to {value}{at}", value=value, at=at_c)
        label = tr("K1 relative to the centre / ppm")
        yield _over_temperature(title, f"{name}-scale", label, "ppm", scale_factor, of_scale)
    k2 = next(finding for finding in unit.findings if finding.quantity == "K2")
    yield _side_by_side(unit, f"{name}-others", {"K2": quantity_of(k2), "misalignment": tr("Misalignment")})


def _middle(unit: UnitResult, quantity: str) -> tuple[float, str, str]:
    """Value of the model at the middle of the temperature range, its place, and the unit; without a model, the mean."""
    for model in unit.models:
        if isinstance(model, TemperatureModel) and model.quantity == quantity:
            return model.coefficients[0], tr(" at {at_c} °C", at_c=f"{model.centre:.1f}"), model.unit
    found = [finding for finding in unit.findings if finding.quantity == quantity]
    return float(np.mean([finding.value for finding in found])), "", found[0].unit


def _over_temperature(title: str, name: str, label: str, symbol: str, points: Points, curves: Sequence[Curve]) -> Plot:
    """Points and models, and below the residuals of each model."""
    fitted = [curve for curve in curves if curve.dof]
    figure = new_figure(4.6 if fitted else 3.0)
    rows = [3, 2] if fitted else [1]
    grid = figure.add_gridspec(len(rows), max(1, len(fitted)), height_ratios=rows, hspace=0.45)
    axes = figure.add_subplot(grid[0, :])
    _draw_legs(axes, points, points.values, points.expanded)
    for curve, style in zip(curves, LINES, strict=False):
        grid_c = np.linspace(*curve.valid_c, 200)
        axes.plot(grid_c, curve.at(grid_c), label=curve.name, zorder=1, **style)
    axes.set(xlabel=temperature_label(), ylabel=label, title=title)
    axes.legend()
    caption = _of_bars(_largest(axes, points.expanded, symbol))
    for column, curve in enumerate(fitted):
        _draw_residuals(figure.add_subplot(grid[1, column]), points, curve, symbol)
    if fitted:
        caption += " " + tr(
            "In the residuals the bars contain only what differs from dwell to dwell, at most {own}; all other "
            "contributions are common to all points.",
            own=f"{_two_digits(points.own.max())} {symbol}",
        )
    heading = tr("{what}, over temperature", what=title)
    return Plot(heading, rendered(figure, name, heading), caption)


def temperature_label() -> str:
    """Label of an axis of the temperature of a unit."""
    return tr("temperature of the unit / °C")


def _of_bars(longest: str) -> str:
    """Caption of the error bars in a figure."""
    return tr("Bars: expanded uncertainty, 95 %: {longest}.", longest=longest)


def _draw_residuals(axes: Axes, points: Points, curve: Curve, symbol: str) -> None:
    axes.axhline(0, color="#444444", linewidth=0.6)
    _draw_legs(axes, points, points.values - curve.at(points.temperature_c), points.own)
    title = tr("Residuals of the {curve}", curve=curve.name)
    axes.set(xlabel=temperature_label(), ylabel=f"{tr('residual')} / {symbol}", title=title)


def _draw_legs(axes: Axes, points: Points, values: Array, bars: Array) -> None:
    """Draw the points, with different markers for rising and falling temperature."""
    for leg, style, label in ((True, RISING, tr("rising temperature")), (False, FALLING, tr("falling temperature"))):
        here = points.rising == leg
        if here.any():
            axes.errorbar(
                points.temperature_c[here], values[here], bars[here], linestyle="none", markersize=MARKER_PT,
                elinewidth=0.8, capsize=2.5, label=label, **style,
            )  # fmt: skip


def _largest(axes: Axes, expanded: Array, symbol: str) -> str:
    """Text of a caption on error bars, which may be too short to be seen."""
    low, high = axes.get_ylim()
    longest_pt = 2 * expanded.max() / (high - low) * axes.get_window_extent().height
    seen = "" if longest_pt > MARKER_PT else tr(", no longer than the markers")
    return tr("at most {high}", high=f"{_two_digits(expanded.max())} {symbol}") + seen


def _two_digits(u: float) -> str:
    return f"{u:.{decimals(u)}f}"


def _loops(name: str, panels: Sequence[tuple[str, str, Points, Curve]]) -> Plot:
    """Residuals of each quantity joined in the order of measurement, which shows hysteresis, side by side."""
    figure = new_figure(3.4)
    for axes, (quantity, symbol, points, model) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        _draw_loop(axes, points, model)
        axes.set(xlabel=temperature_label(), ylabel=f"{tr('residual')} / {symbol}", title=quantity)
        axes.legend()
    title = tr("Hysteresis of bias and scale factor") if len(panels) > 1 else tr("Hysteresis of the bias")
    caption = tr(
        "The residuals of the {curve}, joined in the order of measurement: solid where the temperature rose to the "
        "dwell, dashed where it fell. The numbers are those of the dwells.",
        curve=panels[0][3].name,
    )
    return Plot(title, rendered(figure, name, title), caption)


def _draw_loop(axes: Axes, points: Points, model: Curve) -> None:
    residuals = points.values - model.at(points.temperature_c)
    for index in range(1, len(residuals)):
        style = {"color": RISING["color"]} if points.rising[index] else {"color": FALLING["color"], "linestyle": "--"}
        axes.plot(points.temperature_c[index - 1 : index + 1], residuals[index - 1 : index + 1], linewidth=0.9, **style)
    _draw_legs(axes, points, residuals, points.own)
    if len(residuals) <= MOST_NUMBERS:
        for number, x, y in zip(points.dwell, points.temperature_c, residuals, strict=True):
            axes.annotate(
                str(number), (x, y), (5, 5), textcoords="offset points", fontsize=6.5, color="#444444", bbox=CLEAR
            )
    axes.axhline(0, color="#444444", linewidth=0.6)


def _side_by_side(unit: UnitResult, name: str, titles: Mapping[str, str]) -> Plot:
    """Plots of quantities without a model."""
    figure = new_figure(2.7, top_in=0.48)
    panels = figure.subplots(1, len(titles), squeeze=False)[0]
    bars = []
    for axes, (quantity, title) in zip(panels, titles.items(), strict=True):
        found = next(finding for finding in unit.findings if finding.quantity == quantity)
        factor, symbol = scale_shown(quantity, found.unit)
        points = Scale(factor, symbol).points(unit, quantity)
        if points is not None:
            _draw_legs(axes, points, points.values, points.expanded)
            bars.append(f"{title} {_largest(axes, points.expanded, symbol)}")
        axes.set(xlabel=temperature_label(), ylabel=f"{title} / {symbol}", title=title)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="upper right", ncols=2)
    heading = tr("{what}, over temperature", what=tr(" and ").join(titles.values()))
    return Plot(heading, rendered(figure, name, heading), _of_bars(tr("; ").join(bars)))
