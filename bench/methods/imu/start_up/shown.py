"""Report of the start-up of a compensated inertial unit: settling times, and time histories."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown, shown
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.figures.words import where
from bench.methods.imu.method import CHANGES, IMU_START_UP
from bench.methods.imu.shown import STYLES
from bench.methods.imu.start_up.run import NOT_DETERMINED, StartUpDetail, Watched
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import AXES

TITLES = {
    "K0": "Accelerometers: zero",
    "K1": "Accelerometers: scale factor",
    "D0": "Gyros: zero",
    "KG": "Gyros: scale factor",
}
WHEN = {"power_on": "first", "warm": "warm"}
S_PER_MIN = 60.0
ROOM = 2.2  # of the limit: minimum range of a panel on either side


Found = Mapping[tuple[int, str, str], Finding]
"""Quantities by the number of the power-on, the axis, and the quantity."""


def start_up_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Table of settling times, then the time histories after each power-on."""
    if not isinstance(unit.detail, StartUpDetail):
        return
    found = {(each.at["visit"], each.at["axis"], each.quantity): each for each in unit.findings if "visit" in each.at}
    if found:
        yield _errors(found)
        yield _settling(found)
    for number, (set_c, watched) in enumerate(unit.detail.power_ons):
        if watched:
            yield _courses(set_c, watched, f"{name}-start-up-{number}")


def _rows(found: Found, as_text: Mapping[str, Callable[[Finding], str]]) -> Iterator[tuple[str, ...]]:
    """A row for each axis at each power-on, a formatted cell for each quantity."""
    for visit, axis in dict.fromkeys(key[:2] for key in found):
        of_axis = {quantity: found.get((visit, axis, quantity)) for quantity in as_text}
        set_c = next((each.at["temperature_set_c"] for each in of_axis.values() if each is not None), None)
        cells = ("–" if each is None else as_text[quantity](each) for quantity, each in of_axis.items())
        yield ("–" if set_c is None else f"{set_c:g}", axis, *cells)


def _errors(found: Found) -> Sheet:
    """Residual errors of the compensation right after power-on, and of the warm unit."""
    wanted = {f"{quantity}/{when}": shown for quantity in TITLES for when in WHEN}
    heads = (
        (f"{quantity}, {tr(as_text)}", IMU_START_UP.displayed[f"{quantity}/{when}"])
        for quantity in TITLES
        for when, as_text in WHEN.items()
    )
    return Sheet(
        tr("Residual errors of the compensation after power-on"),
        tr(
            "By set points and axes: at the first reading, and at the end of the observation. Value ± expanded "
            "uncertainty, "
            "95 %. K0 and D0 are zeros, K1 and KG scale factors."),
        ((tr("set point"), "°C"), (tr("axis"), ""), *heads),
        tuple(_rows(found, wanted)),
    )  # fmt: skip


def _settling(found: Found) -> Sheet:
    return Sheet(
        tr("Time from power-on until it stays within its limits"),
        tr(
            "By set points and axes; in brackets the range that contains the true time in 95 of 100 runs, "
            "up to the end of the observation where it is unknown. >: outside to the end; 0: never outside."
        ) + _hardly_determined(found),
        ((tr("set point"), "°C"), (tr("axis"), ""), *((quantity, "min") for quantity in TITLES)),
        tuple(_rows(found, {f"{quantity}/settling": shown for quantity in TITLES})),
    )  # fmt: skip


def _hardly_determined(found: Found) -> str:
    """Settling times that are practically undetermined; empty without one."""
    names = [
        f"{each.quantity.removesuffix('/settling')} {where(each.at, {})}"
        for each in found.values()
        if NOT_DETERMINED in each.flags
    ]
    return " " + tr("Practically not determined: {which}.", which=tr("; ").join(names)) if names else ""


def _courses(set_c: float, watched: Sequence[Watched], name: str) -> Plot:
    """Time histories, zeros left, scale factors right; accelerometers above, gyros below."""
    figure = new_figure(5.6)
    panels = figure.subplots(2, 2, sharex=True, gridspec_kw={"hspace": 0.3, "wspace": 0.3}).ravel()
    for axes, quantity in zip(panels, TITLES, strict=True):
        own = [each for each in watched if each.quantity == quantity]
        axes.set_visible(bool(own))
        if own:
            _panel(axes, quantity, own)
    for axes in panels[2:]:
        axes.set_xlabel(f"{tr('time since power-on')} / min")
    panels[0].legend(ncols=3)
    set_point = tr("set point {set_c} °C", set_c="–" if math.isnan(set_c) else f"{set_c:g}")
    title = tr("Zero and scale factor since power-on, {set_point}", set_point=set_point)
    caption = tr(
        "After compensation by the released calibration: points are readings, lines their courses with their expanded "
        "uncertainty (95 %). The band is the limit from the settings; a vertical line marks when a course enters "
        "it for good.",
    )
    return Plot(title, rendered(figure, name, title), caption)


def _panel(axes: Axes, quantity: str, watched: Sequence[Watched]) -> None:
    factor, symbol = scale_shown(f"{quantity}/warm", CHANGES[quantity][0])
    limit = watched[0].limit * factor
    axes.axhspan(-limit, limit, color="#e7f0e4", linewidth=0)
    for edge in (-limit, limit):
        axes.axhline(edge, color="#4d7c0f", linewidth=0.7, linestyle=(0, (5, 3)))
    largest = ROOM * limit
    for each in sorted(watched, key=lambda one: AXES.index(one.axis)):
        colour, marker = STYLES[each.axis]
        minutes, off, wide = each.grid_s / S_PER_MIN, each.off * factor, COVERAGE * each.u * factor
        axes.fill_between(minutes, off - wide, off + wide, color=colour, alpha=0.15, linewidth=0)
        axes.plot(each.at_s / S_PER_MIN, each.points * factor, color=colour, marker=marker, markersize=2.2,
                  linestyle="none", alpha=0.6)  # fmt: skip
        axes.plot(minutes, off, color=colour, linewidth=1.1, label=each.axis)
        if not (each.settling.to_the_end or each.settling.from_the_start):
            axes.axvline(each.settling.at_s / S_PER_MIN, color=colour, linewidth=0.8, linestyle=(0, (2, 2)))
        largest = max(largest, 1.1 * float(np.abs(off).max()), 1.1 * float(np.abs(each.points).max()) * factor)
    axes.set(ylim=(-largest, largest), ylabel=f"{tr('error of {quantity}', quantity=quantity)} / {symbol}")
    axes.set_title(tr(TITLES[quantity]))
