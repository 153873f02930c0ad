"""Report of a unit beside the tables common to all methods: the readings, as a table and as a plot."""

from collections.abc import Iterator

from bench.figures.languages import tr
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span

from toy_rest.reduction import Rest

MIN_PER_H, PPM = 60, 1e6


def rest_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plot and table of a unit; `name` is the prefix of their ids in the page."""
    if isinstance(unit.detail, Rest):
        yield _plot(unit.detail, f"{name}-rest")
        yield _table(unit.detail, next(found.unit for found in unit.findings if found.quantity == "rest_mean"))


def spans(data: RunData) -> Iterator[Span]:
    """Time of the run that contains the readings, for the plot of its time history."""
    if data.acquisitions:
        yield Span(tr("at rest"), data.acquisitions[0].begin_s, data.acquisitions[-1].end_s)


def _plot(rest: Rest, name: str) -> Plot:
    figure = new_figure(2.8)
    axes = figure.subplots()
    time_min = (rest.time_h - rest.time_h[0]) * MIN_PER_H
    fitted = rest.output - rest.residuals
    axes.plot(time_min, (rest.output / rest.mean - 1) * PPM, "o", color="#0b5394", markersize=4)
    axes.plot(time_min, (fitted / rest.mean - 1) * PPM, color="#222222", linewidth=0.8)
    title = tr("Output at rest, relative to its mean")
    axes.set(xlabel=f"{tr('time')} / min", ylabel=f"{tr('output / mean - 1')} / ppm", title=title)
    caption = tr("Points: readings. Line: least squares; its slope is the drift.")
    return Plot(title, rendered(figure, name, title), caption)


def _table(rest: Rest, unit: str) -> Sheet:
    heads = ((tr("Number"), ""), (tr("Time"), "min"), (tr("Output"), unit), (tr("Residual"), "ppm"))
    rows = tuple(
        (str(number), f"{(at_h - rest.time_h[0]) * MIN_PER_H:.2f}", f"{output:.9g}", f"{left / rest.mean * PPM:+.2f}")
        for number, (at_h, output, left) in enumerate(zip(rest.time_h, rest.output, rest.residuals, strict=True), 1)
    )
    caption = tr("Means of the acquisitions, and what the line leaves of them.")
    return Sheet(tr("Readings at rest"), caption, heads, rows)
