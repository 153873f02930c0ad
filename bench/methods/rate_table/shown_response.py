"""Report of a frequency response: Bode plot with bandwidth and table amplitude, and a table of the points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import shown
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.methods.rate_table.reduction.response_points import HALF_POWER, Bandwidth, FrequencyResponse, Waveform
from bench.methods.rate_table.shown_assembly import of_each_sensor
from bench.metrology.results.finding import Finding, UnitResult

DB_PER_RELATIVE = 20 / np.log(10)
HALF_POWER_DB = 20 * np.log10(HALF_POWER)
PERIODS = 4
BLUE, BROWN, GREY = "#0b5394", "#b45309", "#777777"


def response_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Bode plot and points of each sensor; `name` is the prefix of the ids in the page."""
    yield from of_each_sensor(unit, name, _of_one)


def _of_one(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    found = unit.detail
    if not isinstance(found, FrequencyResponse) or not found.points:
        return
    gains, phases = (_of(unit, quantity) for quantity in ("gain", "phase"))
    yield _bode(found, gains, phases, name)
    if found.waveform is not None:
        yield _waveform(found.waveform, name)
    yield _points(found, gains, phases)


def _of(unit: UnitResult, quantity: str) -> list[Finding]:
    return [finding for finding in unit.findings if finding.quantity == quantity]


def _bode(found: FrequencyResponse, gains: Sequence[Finding], phases: Sequence[Finding], name: str) -> Plot:
    figure = new_figure(6.2)
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1.4], gridspec_kw={"hspace": 0.16})
    frequency_hz = np.array([point.frequency_hz for point in found.points])
    bars_db = DB_PER_RELATIVE * np.array([each.expanded / each.value if each.value else 0.0 for each in gains])
    _draw(above, frequency_hz, np.array([point.gain_db for point in found.points]), bars_db)
    _draw(middle, frequency_hz, np.array([each.value for each in phases]), np.array([e.expanded for e in phases]))
    _mark_bandwidth(above, middle, found.bandwidth)
    amplitude_dps = [point.table_amplitude_dps for point in found.points]
    below.plot(frequency_hz, amplitude_dps, ".-", color=BROWN, linewidth=0.8, markersize=4)
    below.set_ylim(0, 1.15 * max(amplitude_dps))
    above.set(ylabel=tr("gain / dB"), title=tr("Frequency response"))
    middle.set(ylabel=tr("phase / °"))
    below.set(xlabel=tr("frequency / Hz"), ylabel=tr("table / (°/s)"), xscale="log")
    below.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    below.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    title = tr("Frequency response")
    caption = tr(
        "Gain, phase, and the amplitude of the rate that the table swung with, as read by its encoder. Bars: expanded "
        "uncertainty, 95 %, mostly shorter than the markers."
    )
    return Plot(title, rendered(figure, f"{name}-bode", title), caption)


def _draw(axes: Axes, frequency_hz: np.ndarray, values: np.ndarray, bars: np.ndarray) -> None:
    axes.errorbar(
        frequency_hz, values, bars, marker="o", markersize=3, color=BLUE, linewidth=0.8, elinewidth=0.8, capsize=2
    )  # fmt: skip


def _mark_bandwidth(gain: Axes, phase: Axes, bandwidth: Bandwidth) -> None:
    """Mark half the power, and the frequency at which the gain falls through it."""
    gain.axhline(HALF_POWER_DB, color=GREY, linewidth=0.7, linestyle="--", label=tr("-3 dB"))
    if bandwidth.frequency_hz is not None:
        label = tr("bandwidth {hz} Hz", hz=f"{bandwidth.frequency_hz:.2f}")
        gain.axvline(bandwidth.frequency_hz, color=GREY, linewidth=0.7, label=label)
        phase.axvline(bandwidth.frequency_hz, color=GREY, linewidth=0.7)
    gain.legend(loc="lower left")


def _waveform(wave: Waveform, name: str) -> Plot:
    """Draw the first periods of an oscillation, as the encoder and as the sensor have it, and their difference."""
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1], gridspec_kw={"hspace": 0.16})
    first = wave.time_s - wave.time_s[0] < PERIODS / wave.frequency_hz
    time_ms = (wave.time_s[first] - wave.time_s[0]) * 1e3
    above.plot(time_ms, wave.reference[first], "-", color=GREY, linewidth=1.2, label=tr("encoder"))
    above.plot(time_ms, wave.output[first], ".-", color=BLUE, linewidth=0.6, markersize=4, label=tr("sensor"))
    above.legend(loc="lower left")
    below.plot(time_ms, wave.output[first] - wave.reference[first], ".-", color=BROWN, linewidth=0.6, markersize=3)
    title = tr("Waveform at {hz} Hz", hz=f"{wave.frequency_hz:.6g}")
    above.set(ylabel=wave.unit, title=title)
    below.set(xlabel=tr("time / ms"), ylabel=tr("difference") + f" / {wave.unit}")
    caption = tr(
        "Means over the same intervals, one sample of a gyro and two of an accelerometer, about their mean. The "
        "reference of an accelerometer is that of two samples. Ratio of the two sines: {gain}.",
        gain=f"{wave.gain:.5f}",
    )
    return Plot(title, rendered(figure, f"{name}-waveform", title), caption)


def _points(found: FrequencyResponse, gains: Sequence[Finding], phases: Sequence[Finding]) -> Sheet:
    heads = (
        (tr("Frequency"), "Hz"), (tr("Gain"), ""), (tr("Gain"), "dB"), (tr("Phase"), "°"), (tr("Table"), "°/s"),
    )  # fmt: skip
    rows = tuple(
        (
            f"{point.frequency_hz:.6g}", shown(gain), f"{point.gain_db:.4f}", shown(phase),
            f"{point.table_amplitude_dps:.4f}",
        )
        for point, gain, phase in zip(found.points, gains, phases, strict=True)
    )  # fmt: skip
    return Sheet(tr("Points of the sweep"), tr("Value ± expanded uncertainty, 95 %."), heads, rows)
