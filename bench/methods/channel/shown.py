"""Report of a channel at its input levels: decisions and three plots, for each channel of the unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import shown
from bench.figures.plots import Plot, TimeOfRun
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.methods.channel.reduction.compared_levels import Compared, Level
from bench.methods.channel.reduction.decision import Basis
from bench.methods.channel.reduction.inertial import InertialDetail
from bench.methods.channel.reduction.levels import input_level, is_ramp
from bench.methods.channel.reduction.run import ChannelDetail
from bench.metrology.acquisition import Acquisition
from bench.metrology.least_squares import Array
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.spans import Span

COLOURS = ("#0b5394", "#b45309", "#38761d", "#741b47", "#134f5c", "#7f6000")
STRETCHES = 24  # number of means in the plot of a run
PPM = 1e6


def channel_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Table and plots of a unit; `name` is the prefix of their ids in the page."""
    if isinstance(unit.detail, InertialDetail):
        for axis, detail in unit.detail.channels.items():
            yield from _of_channel(unit, detail, f"{name}-{axis}", axis)
    else:
        yield from _of_channel(unit, unit.detail, name)


def _of_channel(unit: UnitResult, detail: object, name: str, axis: str = "") -> Iterator[Plot | Sheet]:
    """The same of one channel; `axis` is that of a channel of an inertial unit."""
    if not isinstance(detail, ChannelDetail):
        return
    drawn = [level for level in detail.levels if np.isfinite(level.run.slope_per_c)]
    if detail.compared:
        yield _decisions(unit, detail, axis)
    if drawn:
        yield _over_temperature(drawn, detail, f"{name}-rate", axis)
        yield _slopes(drawn, detail, f"{name}-slopes", axis)
        yield _course(drawn, detail.span_s, f"{name}-ramps", axis)


def _titled(title: str, axis: str) -> str:
    """Title of a part of the report, with the axis of a channel of an inertial unit."""
    return tr("axis {axis}", axis=axis) + tr(": ") + title if axis else title


# Text of the comparisons of levels


def _decisions(unit: UnitResult, detail: ChannelDetail, axis: str) -> Sheet:
    allowed, per_c = f"{detail.threshold * 100:g}", f"{detail.output_unit}/°C"
    basis_text = (
        tr("The decision uses slopes in {unit}; they may deviate by {threshold} %.", unit=per_c, threshold=allowed)
        if detail.basis == "raw"
        else tr(
            "The decision uses slopes relative to the output; they may deviate by {threshold} %.", threshold=allowed
        )
    )
    why = tr(
        "A drift in proportion to the level makes slopes in {unit} follow the level, and leaves those relative to the "
        "output alike; a drift that is the same at all levels does the opposite.",
        unit=per_c,
    )
    each_in_words = " ".join(
        each.level.name + tr(": ") + tr("; ").join(_in_words(each, detail)) + tr(".") for each in detail.compared
    )
    return Sheet(
        _titled(tr("Whether the model of one level serves another"), axis),
        f"{basis_text} {why} {each_in_words}",
        (
            (tr("Level"), ""), (tr("Against"), ""), (tr("Slopes deviate"), "%"), (tr("Decision by slopes"), ""),
            (tr("Relative slopes deviate"), "%"), (tr("Decision by relative slopes"), ""),
        ),
        tuple(_decision_row(unit, each, axis) for each in detail.compared),
    )  # fmt: skip


def _decision_row(unit: UnitResult, each: Compared, axis: str) -> tuple[str, ...]:
    values = {
        finding.quantity: shown(finding)
        for finding in unit.findings
        if finding.at.get("run") == each.level.name and "reference" in finding.at and finding.at.get("axis", "") == axis
    }
    return (
        each.level.name, each.reference.name, values.get("deviation/raw", "–"), _decided(each, "raw"),
        values.get("deviation/normalised", "–"), _decided(each, "normalised"),
    )  # fmt: skip


def _decided(each: Compared, basis: Basis) -> str:
    """Decision on one basis in words."""
    decision, marginal = each.decided(basis)
    return tr(decision) + (tr(", ") + tr("marginal") if marginal else "")


def _in_words(each: Compared, detail: ChannelDetail) -> Iterator[str]:
    found = each.comparison
    match found.decision:
        case "share":
            yield tr(
                "one model serves both: the slope of {reference}, with its own output", reference=each.reference.name
            )
        case "keep":
            yield tr("needs its own model")
        case "invalid":
            yield from (tr(remark) for remark in found.remarks)
            return
    yield from (tr(remark) for remark in found.remarks)
    raw, normalised = found.raw.value <= detail.threshold, found.normalised.value <= detail.threshold
    if normalised and not raw:
        yield tr("its slope differs because its level does; relative to the output the drift is the same")
    elif raw and not normalised:
        yield tr("its slope is the same at another level: the drift is not proportional to the input")
    if each.drifted:
        yield tr("marginal: an input drifted more than allowed between the points at rest")
    elif each.marginal:
        yield tr("marginal: the deviation is close to its limit")


# Plots


def _over_temperature(levels: list[Level], detail: ChannelDetail, name: str, axis: str) -> Plot:
    figure = new_figure(5.4)
    above, below = figure.subplots(2, 1, height_ratios=[3, 2], gridspec_kw={"hspace": 0.4})
    below.axhline(0, color="#444444", linewidth=0.6)
    for level, colour in zip(levels, _colours(levels), strict=True):
        temperature_c, relative, residual = _means(level, detail.reference_c)
        ends_c = np.array([np.min(temperature_c), np.max(temperature_c)])
        line = level.run.relative_slope_per_c * (ends_c - detail.reference_c) * PPM
        above.plot(temperature_c, relative, "o", color=colour, markersize=3, label=_label(level))
        above.plot(ends_c, line, color=colour, linewidth=0.8)
        below.plot(temperature_c, residual, "o-", color=colour, markersize=3, linewidth=0.6)
    at = f"{detail.reference_c:g} °C"
    above.set(xlabel=_converter(), ylabel=f"D / D({at}) - 1 / ppm", title=tr("Output relative to that at {at}", at=at))
    above.legend(ncols=2)
    below.set(xlabel=_converter(), ylabel=f"{tr('residual')} / ppm", title=tr("Residuals of the straight lines"))
    title = _titled(tr("Output of the channel over the temperature of its converter"), axis)
    caption = tr(
        "Means of {count} parts of each run, and straight lines through all its read-outs. Levels whose drift is "
        "proportional to the input lie on one line.",
        count=STRETCHES,
    )
    return Plot(title, rendered(figure, name, title), caption)


def _means(level: Level, reference_c: float) -> tuple[Array, Array, Array]:
    """Means of stretches of a run in temperature order: temperature, rate and residual relative to D_ref in ppm."""
    run, gates = level.run, level.run.gates
    order = np.argsort(gates.converter_c, kind="stable")
    parts = [part for part in np.array_split(order, STRETCHES) if len(part)]
    temperature_c = np.array([np.mean(gates.converter_c[part]) for part in parts])
    rate = np.array([np.sum((gates.rate * gates.seconds)[part]) / np.sum(gates.seconds[part]) for part in parts])
    relative = (rate / run.rate - 1) * PPM
    return temperature_c, relative, relative - run.relative_slope_per_c * (temperature_c - reference_c) * PPM


def _slopes(levels: list[Level], detail: ChannelDetail, name: str, axis: str) -> Plot:
    """Relative slope of each level with its own uncertainty, and the permitted deviation from the reference."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    decisions = {each.level.name: each for each in detail.compared}
    for number, (level, colour) in enumerate(zip(levels, _colours(levels), strict=True)):
        slope, run = level.run.relative_slope_per_c * PPM, level.known_run
        bar = COVERAGE * run.u_relative_slope_per_c * PPM
        axes.errorbar(number, slope, bar, marker="o", color=colour, capsize=3, linestyle="none")
        each = decisions.get(level.name)
        if each is not None:
            _draw_allowed(axes, number, each, detail)
            decision = tr(each.comparison.decision)
            axes.annotate(decision, (number, slope), (10, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_xticks(range(len(levels)), [_label(level) for level in levels])
    axes.set_xlim(-0.5, len(levels) - 0.3)
    title = _titled(tr("Slopes of the levels relative to their outputs"), axis)
    axes.set(ylabel="κ / (ppm/°C)", title=title)
    caption = tr(
        "Bars: expanded uncertainty, 95 %, without the part common to all levels. Grey: the allowed deviation "
        "from the reference level, where relative slopes decide."
    )
    return Plot(title, rendered(figure, name, title), caption)


def _draw_allowed(axes: Axes, number: int, each: Compared, detail: ChannelDetail) -> None:
    if detail.basis != "normalised":
        return
    reference = each.reference.run.relative_slope_per_c * PPM
    height = 2 * detail.threshold * abs(reference)
    axes.bar(number, height, 0.6, reference - height / 2, color="#dddddd", zorder=0)


def _course(levels: list[Level], span_s: tuple[float, float], name: str, axis: str) -> Plot:
    """Time history of the levels, on the time axis of the run's other plots."""
    figure = new_figure(3.4)
    axes, over_run = figure.subplots(), TimeOfRun(*span_s)
    for level, colour in zip(levels, _colours(levels), strict=True):
        gates = level.run.gates
        at = over_run.at(gates.time_s)
        axes.plot(at, gates.converter_c, ".", color=colour, markersize=2, label=_label(level))
        if not level.is_source:
            axes.plot(at, gates.accelerometer_c, ".", color="#999999", markersize=1)
    title = _titled(tr("Temperature of the converter while each level was counted"), axis)
    axes.set(ylabel=tr("temperature / °C"), title=title)
    over_run.finish(axes)
    axes.legend(ncols=2)
    caption = tr("The read-outs used. Grey: the accelerometer, where it was connected.")
    return Plot(title, rendered(figure, name, title), caption)


def _converter() -> str:
    return tr("temperature of the converter / °C")


def _colours(levels: list[Level]) -> list[str]:
    return [COLOURS[number % len(COLOURS)] for number in range(len(levels))]


def _label(level: Level) -> str:
    return f"{level.name} ({level.data.level.level_g:.4g} g)"


def levels(data: RunData) -> Iterator[Span]:
    """Ramps of input levels, by the names of the levels; the points at rest have none."""
    for each in data.acquisitions:
        names = [name for unit in data.units for name in _names(data, unit, each)] if is_ramp(each) else []
        yield Span(" / ".join(dict.fromkeys(names)), each.begin_s, each.end_s)


def _names(data: RunData, unit: UnitUnderTest, acquisition: Acquisition) -> Iterator[str]:
    """Names of the level of a unit, or of the levels of the channels of an inertial unit, with their axes."""
    found = {channel.axis: input_level(data, channel, acquisition) for channel in unit.accelerometers}
    named = {axis: level.name for axis, level in found.items() if level is not None}
    alike = len(found) == 1 or (len(named) == len(found) and len(set(named.values())) == 1)
    yield from (name if alike else f"{axis} {name}" for axis, name in named.items())
