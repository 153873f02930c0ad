"""Report of the errors of a sensor over its range: a table of the points, and a plot with the limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown, shown
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.figures.words import REASONS
from bench.methods.rate_table.reduction.range_findings import RangeCurve
from bench.methods.rate_table.shown_assembly import of_each_sensor
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span, in_unit

RELATIVE = "/relative"
GOOD, BAD = "#0b5394", "#b42318"
LEAST_SHOWN, SHOWN_AT = 0.01, 60  # of the full scale; number of points on each side of the curve


def range_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plot and table of each sensor with at least one point; `name` is the prefix of the ids in the page."""
    yield from of_each_sensor(unit, name, _of_one)


def _of_one(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    curve = unit.detail
    if not isinstance(curve, RangeCurve) or not curve.points:
        return
    judged = [finding for finding in unit.findings if finding.quantity.endswith(RELATIVE)]
    yield _figure(curve, judged, name)
    yield _points(curve, unit, judged)


def _figure(curve: RangeCurve, judged: Sequence[Finding], name: str) -> Plot:
    figure = new_figure(3.4)
    axes = figure.subplots()
    factor = scale_shown(judged[0].quantity, judged[0].unit)[0]
    true = np.array([point.true for point in curve.points])
    error = np.array([finding.value for finding in judged]) * factor
    bars = np.array([finding.expanded for finding in judged]) * factor
    at_end = np.array([point.saturated for point in curve.points])
    axes.axhline(0, color="#444444", linewidth=0.6)
    _draw_curve(axes, curve, factor)
    _draw_allowed(axes, judged[0], factor)
    for chosen, colour, marker, label in (
        (~at_end, GOOD, "o", tr("error")), (at_end, BAD, "x", tr("saturated")),
    ):  # fmt: skip
        if chosen.any():
            axes.errorbar(
                true[chosen], error[chosen], bars[chosen], linestyle="none", marker=marker, markersize=4, color=colour,
                capsize=2.5, elinewidth=0.8, label=label,
            )  # fmt: skip
    of_rate = curve.quantity == "rate"
    what = tr("rate of the table / °/s") if of_rate else tr("acceleration / g")
    basis = tr("error relative to the full scale") if curve.full_scale else tr("error relative to what is true")
    axes.set(xlabel=what, ylabel=f"{basis} / ppm")
    axes.legend()
    title = tr("Errors over the range")
    caption = tr("Bars: expanded uncertainty, 95 %. Shaded: the limits of the sequence.")
    return Plot(title, rendered(figure, f"{name}-range", title), caption)


def _draw_curve(axes: Axes, curve: RangeCurve, factor: float) -> None:
    """Draw the curve through the points, separately on either side of 0."""
    found = curve.linearity
    if found is None:
        return
    least = LEAST_SHOWN * found.full_scale
    sides = [np.linspace(low, high, SHOWN_AT) for low, high in ((found.valid[0], -least), (least, found.valid[1]))]
    label = tr("curve through the points")
    for true in sides:
        if true[0] < true[-1]:
            error = found.relative(true) * true / (curve.full_scale or np.abs(true))
            axes.plot(true, error * factor, color="#444444", linewidth=0.8, label=label, zorder=1)
            label = "_nolegend_"


def _draw_allowed(axes: Axes, finding: Finding, factor: float) -> None:
    limits = finding.limits
    if limits is not None and limits.low is not None and limits.high is not None:
        axes.axhspan(limits.low * factor, limits.high * factor, color="#dcfce7", zorder=0, label=tr("allowed"))


def _points(curve: RangeCurve, unit: UnitResult, judged: Sequence[Finding]) -> Sheet:
    errors = [finding for finding in unit.findings if f"{finding.quantity}{RELATIVE}" == judged[0].quantity]
    heads = [(tr("Rate asked for"), "°/s"), (tr("True"), "°/s" if curve.quantity == "rate" else "g")]
    heads += [
        (tr("Error"), scale_shown(errors[0].quantity, errors[0].unit)[1]), (tr("Relative error"), "ppm"),
        (tr("Verdict"), ""), (tr("Remark"), ""),
    ]  # fmt: skip
    rows = []
    for point, error, relative in zip(curve.points, errors, judged, strict=True):
        remarks = tr("; ").join(tr(REASONS[flag]) for flag in error.flags if flag in REASONS)
        digits = decimals(point.expanded)
        rows.append((
            f"{error.at['rate_dps']:.6g}", f"{point.true:.{digits}f}", shown(error, marked=False),
            shown(relative, marked=False), tr(relative.verdict) if relative.verdict else tr("not judged"),
            tr(", ").join(filter(None, (tr("marginal") if relative.marginal else "", remarks))) or "–",
        ))  # fmt: skip
    caption = tr("Value ± expanded uncertainty, 95 %.")
    return Sheet(tr("Points of the range"), caption, tuple(heads), tuple(rows))


def motions(data: RunData) -> Iterator[Span]:
    """Points of a range or of a sweep, by rate or frequency; at rest they have no name."""
    for each in data.acquisitions:
        motion, name = each.motion, ""
        if motion is not None and motion.frequency_hz is not None:
            name = in_unit(motion.frequency_hz, "Hz")
        elif motion is not None and motion.rate_dps is not None:
            name = in_unit(motion.rate_dps, "°/s")
        yield Span(name, each.begin_s, each.end_s)
