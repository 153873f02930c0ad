"""Report of the sweeps on an indexing table: lines, residuals, every attempt."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import decimals, shown, with_expanded
from bench.figures.plots import Plot
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.figures.words import end_in_words
from bench.methods.indexing.reduction.readings import kind_of
from bench.methods.indexing.reduction.run import Attempt, IndexingDetail
from bench.methods.indexing.reduction.sweep import EndFit
from bench.metrology.acquisition import Acquisition
from bench.metrology.orientation import unit_axes
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.curves import Equation
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData
from bench.reduce.spans import Span

UG_PER_G = 1e6
PPM = 1e6
LEGEND_IN = 0.36  # space above axes for a one-line legend with its frame; Chinese characters need more
COLOURS = {"up": "#0b5394", "down": "#b45309"}
MARKERS = {"fwd": "^", "rev": "v"}


def indexing_shown(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Plots and tables; `name` is the prefix of the ids in the page."""
    detail = unit.detail
    if not isinstance(detail, IndexingDetail):
        return
    last = detail.attempts[-1]
    fits = {end: sweep.fit for end, sweep in last.found.ends.items() if sweep is not None and sweep.fit is not None}
    if fits:
        yield _sweep(fits, detail, f"{name}-sweep")
        yield _residuals(fits, detail, f"{name}-residuals")
        yield _ends(unit, fits, detail.unit)
    if last.found.both is not None:
        yield _attempts(unit, detail)


def _sweep(fits: dict[str, EndFit], detail: IndexingDetail, name: str) -> Plot:
    figure = new_figure(3.2)
    axes = figure.subplots()
    for end, fit in fits.items():
        angles_deg = fit.dwells.angle_deg
        ends_deg = np.array([angles_deg.min(), angles_deg.max()])
        line = fit.bias_v + fit.scale_v_per_g * np.sin(np.radians(ends_deg))
        axes.plot(ends_deg, line, color=COLOURS[end], linewidth=0.7)
        _draw(axes, end, fit, fit.dwells.output_v)
    axes.set(xlabel=_angle_label(), ylabel=f"{tr('output')} / {detail.unit}", title=tr("Output over the angle"))
    axes.legend(ncols=2)
    title = tr("Sweeps of both ends") if len(fits) == 2 else tr("Sweep of one end")
    caption = tr("The fitted readings of the last attempt at both ends, and their lines.")
    return Plot(title, rendered(figure, name, title), caption)


def _residuals(fits: dict[str, EndFit], detail: IndexingDetail, name: str) -> Plot:
    """Residuals of the line of each end, one above the other; readings of the verification if there are any."""
    figure = new_figure(2.3 + 1.9 * len(fits), top_in=LEGEND_IN)
    panels = figure.subplots(len(fits), 1, squeeze=False, sharex=True, gridspec_kw={"hspace": 0.35})[:, 0]
    for axes, (end, fit) in zip(panels, fits.items(), strict=True):
        axes.axhline(0, color="#444444", linewidth=0.6)
        _draw(axes, end, fit, fit.residuals / fit.scale_v_per_g * UG_PER_G)
        checked = [
            (np.degrees(reading.angle_rad), residual_g * UG_PER_G)
            for reading, residual_g in zip(detail.verification, detail.residuals_g, strict=False)
            if reading.end == end
        ]
        if checked:
            axes.plot(*zip(*checked, strict=True), "x", color="#4d7c0f", label=tr("verification"), zorder=3)
        axes.set(ylabel=f"{tr('residual')} / µg", title=end_in_words(end))
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1))  # beside the title, clear of all points
    panels[-1].set_xlabel(_angle_label())
    title = tr("Residuals of both ends") if len(fits) == 2 else tr("Residuals of one end")
    caption = tr(
        "Residuals of the line of each end, in g by its scale factor: forward away from 0°, reverse back to it. "
        "Crosses: readings of the verification, which were not fitted, with the equation of their end."
    )
    return Plot(title, rendered(figure, name, title), caption)


def _draw(axes: Axes, end: str, fit: EndFit, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    for direction, marker in MARKERS.items():
        here = fit.dwells.direction == direction
        if here.any():
            way = tr("forward") if direction == "fwd" else tr("reverse")
            face = COLOURS[end] if direction == "fwd" else "white"
            axes.plot(
                fit.dwells.angle_deg[here], values[here], marker, color=COLOURS[end], markerfacecolor=face,
                markersize=4.5, linestyle="none", label=f"{end_in_words(end)}{tr(', ')}{way}",
            )  # fmt: skip


def _angle_label() -> str:
    return f"{tr('angle of the table')} / °"


def _ends(unit: UnitResult, fits: dict[str, EndFit], output: str) -> Sheet:
    linearity = {found.at["end"]: shown(found) for found in unit.findings if found.quantity == "linearity"}
    hysteresis = next((found for found in unit.findings if found.quantity == "hysteresis"), None)
    digits = 1 if hysteresis is None else decimals(hysteresis.expanded * UG_PER_G)
    rows = tuple(
        (
            end_in_words(end), str(len(fit.dwells)), _constant(unit, end, "b"), _constant(unit, end, "K1"),
            f"{fit.reading_sd_v / abs(fit.scale_v_per_g) * UG_PER_G:.2g}", linearity.get(end, "–"),
            "–" if fit.hysteresis_v is None else f"{fit.hysteresis_v / abs(fit.scale_v_per_g) * UG_PER_G:.{digits}f}",
        )
        for end, fit in fits.items()
    )  # fmt: skip
    heads = (
        (tr("End"), ""), (tr("Readings"), ""), ("b", output), ("K1", f"{output}/g"), (tr("Scatter"), "µg"),
        (tr("Linearity"), "ppm"), (tr("Hysteresis"), "µg"),
    )  # fmt: skip
    caption = " ".join([
        tr("U = b + K1·sin θ of each end, for tests on the ground in that orientation."),
        tr("Value ± expanded uncertainty, 95 %. An exclamation mark: FAIL, or INVALID."),
        tr("The larger hysteresis is a result, with its uncertainty, in the results of the whole run."),
    ])  # fmt: skip
    return Sheet(tr("The two ends"), caption, heads, rows)


def _constant(unit: UnitResult, end: str, name: str) -> str:
    """A coefficient of the equation of an end, as in the results."""
    for model in unit.models:
        if isinstance(model, Equation) and model.quantity == f"acceleration_{end}":
            constant = model.constants[name]
            return with_expanded(constant.value, COVERAGE * (constant.u or 0.0))
    return "–"


def _attempts(unit: UnitResult, detail: IndexingDetail) -> Sheet:
    *earlier, last = detail.attempts
    rows = [_earlier_attempt(number, attempt) for number, attempt in enumerate(earlier, start=1)]
    difference = next(shown(found) for found in unit.findings if found.quantity == "scale_difference")
    scales = [_constant(unit, end, "K1") for end in ("up", "down")]
    rows.append((str(len(detail.attempts)), *scales, difference, _decision(last)))
    heads = (
        (tr("Attempt"), ""), (tr("K1, +Z up"), f"{detail.unit}/g"), (tr("K1, +Z down"), f"{detail.unit}/g"),
        (tr("Difference"), "ppm"), (tr("Decision"), ""),
    )  # fmt: skip
    parts = [
        tr(
            "Both ends are measured again if their scale factors differ by more than allowed; the last "
            "attempt counts. A remaining difference is the cross coupling."
        ),
        tr("Value ± expanded uncertainty, 95 %. An exclamation mark: FAIL, or INVALID."),
    ]
    if earlier:
        parts.append(tr("For earlier attempts it covers only the residuals of each line, without the instruments."))
    return Sheet(tr("Scale factors of both ends"), " ".join(parts), heads, tuple(rows))


def _earlier_attempt(number: int, attempt: Attempt) -> tuple[str, ...]:
    """A row for an earlier attempt, which has no findings: its uncertainties are those of its own lines."""
    both = attempt.found.both
    fits = [sweep.fit if sweep else None for sweep in attempt.found.ends.values()]
    scales = ["–" if fit is None else with_expanded(fit.scale_v_per_g, COVERAGE * float(fit.u[1])) for fit in fits]
    if both is None:
        return (str(number), *scales, "–", tr("invalid"))
    difference, ppm = both.scale_difference_v_per_g, PPM / abs(both.scale_v_per_g.value)
    return (
        str(number),
        *scales,
        with_expanded(difference.value * ppm, COVERAGE * difference.u * ppm),
        _decision(attempt),
    )


def _decision(attempt: Attempt) -> str:
    return tr("agree") if attempt.agrees else tr("differ")


def ends(data: RunData) -> Iterator[Span]:
    """Sweeps of an indexing table, by the end on which the units stood; clocking readings in between have no name."""

    def name(acquisition: Acquisition) -> str:
        match kind_of(acquisition.step):
            case "sweep":
                ups = [unit_axes(acquisition, unit, data.bench)[:, 2] for unit in data.units]
                return " / ".join(dict.fromkeys(map(_face_in_words, ups)))
            case "verification":
                return tr("verification")
        return ""

    for called, members in groupby(data.acquisitions, key=name):
        together = list(members)
        yield Span(called, together[0].begin_s, together[-1].end_s)


def _face_in_words(up: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    """Text of the end or side on which a unit stands; `up` is the vertical in its axes."""
    if abs(up[2]) >= abs(up[1]):
        return end_in_words("up" if up[2] > 0 else "down")
    return tr("+Y up") if up[1] > 0 else tr("+Y down")
