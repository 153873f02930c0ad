"""Report of an inertial unit: tables of its axes at the set points, coefficients over temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes

from bench.figures.languages import tr
from bench.figures.numbers import scale_shown, shown
from bench.figures.plots import Array, Plot, temperature_label
from bench.figures.sheet import Sheet
from bench.figures.svg import new_figure, rendered
from bench.figures.words import quantity_in_words, unit_shown
from bench.methods.imu.method import CHANGES
from bench.methods.imu.reduction.knots import check_model
from bench.methods.imu.reduction.regressed import QUANTITIES
from bench.methods.imu.reduction.run import RELATIVE, ImuDetail
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import AXES, RunData
from bench.reduce.spans import Span, in_unit, over_groups

STYLES = {"x": ("#0b5394", "o"), "y": ("#b45309", "s"), "z": ("#4d7c0f", "D")}
BESIDE = 0.03  # of the temperature range: horizontal offset between axes drawn at equal temperatures
SENSORS = {"accelerometers": ("K0", "K1", "K2"), "gyros": ("D0", "KG")}
TITLES = {
    "accelerometers": "The accelerometers at the set points",
    "gyros": "The gyros at the set points",
}
MATRICES = {
    "misalignment": "Misalignment of the accelerometers",
    "gyro_misalignment": "Misalignment of the gyros",
    "g_sensitivity": "g-sensitivity of the gyros",
}


def imu_plots(unit: UnitResult, name: str) -> Iterator[Plot | Sheet]:
    """Values at the set points, matrices, and coefficients over temperature; `name` is the prefix of the ids."""
    at_visits = [finding for finding in unit.findings if "visit" in finding.at]
    units = {finding.quantity: unit_shown(finding.quantity, finding.unit) for finding in at_visits}
    for sensor, quantities in SENSORS.items():
        if rows := list(_rows(at_visits, quantities)):
            heads = [(quantity_in_words(each), units.get(each, "")) for each in quantities]
            yield Sheet(
                tr(TITLES[sensor]),
                tr("With expanded uncertainties, 95 %. Set points in the order of the run.")
                + (" " + tr("K0 contains K2, K1 contains K3.") if "K0" in quantities else ""),
                ((tr("set point"), "°C"), (tr("temperature"), "°C"), (tr("axis"), ""), *heads),
                tuple(rows),
            )
    first = [finding for finding in at_visits if finding.at["visit"] == 0]
    for quantity, title in MATRICES.items():
        if found := [finding for finding in first if finding.quantity == quantity]:
            yield _matrix(found, quantity, tr(title))
    if isinstance(unit.detail, ImuDetail):
        yield _at_nominal(unit, unit.detail)
        for sensor, pair in (("accelerometers", ("K0", "K1")), ("gyros", ("D0", "KG"))):
            if any(len(unit.detail.curves[quantity, 0][0]) > 1 for quantity in pair):
                yield _over_temperature(unit, unit.detail, pair, f"{name}-{sensor}")


def _at_nominal(unit: UnitResult, detail: ImuDetail) -> Sheet:
    """Each sensor with its thermometer, its nominal temperature, and its output over temperature, before and after."""
    results = {(each.quantity, each.at.get("axis")): each for each in unit.findings}
    rows = []
    for sensor, axis in product(QUANTITIES, range(len(AXES))):
        output, channel = detail.outputs.get((sensor, axis)), f"{sensor}_{AXES[axis]}"
        of = [f"{QUANTITIES[sensor][0]}/{what}" for what in ("change", "left")]
        found = [results.get((quantity, AXES[axis])) for quantity in of]
        rows.append((
            channel, detail.unit.thermometer(channel), f"{output.nominal_c:.2f}" if output and output.is_known else "–",
            *("–" if each is None else shown(each) for each in found),
            detail.unit.output_unit if sensor == "acc" else detail.unit.gyro_output_unit,
        ))  # fmt: skip
    return Sheet(
        tr("Outputs regressed to the nominal temperature"),
        tr("Largest change of the output over temperature, at 1 g or the largest rate: without compensation, and at a "
           "temperature that was left out, about four times what compensation leaves. 95 %."),
        ((tr("sensor"), ""), (tr("thermometer"), ""), (tr("nominal temperature"), "°C"), (tr("before"), ""),
         (tr("after"), ""), (tr("unit"), "")),
        tuple(rows),
    )  # fmt: skip


def _rows(at_visits: Sequence[Finding], quantities: Sequence[str]) -> Iterator[tuple[str, ...]]:
    by_place: dict[tuple[int, str], dict[str, Finding]] = {}
    for finding in at_visits:
        if finding.quantity in quantities:
            by_place.setdefault((finding.at["visit"], finding.at["axis"]), {})[finding.quantity] = finding
    for (_, axis), found in sorted(by_place.items()):
        at = next(iter(found.values())).at
        set_c = "–" if at["temperature_set_c"] is None else f"{at['temperature_set_c']:g}"
        values = [shown(found[quantity]) if quantity in found else "–" for quantity in quantities]
        yield (set_c, f"{at['temperature_c']:.2f} ± {COVERAGE * at['temperature_u_c']:.2f}", axis, *values)


def _matrix(found: Sequence[Finding], quantity: str, title: str) -> Sheet:
    """Matrix with a row for each sensor, a column for each axis that it senses."""
    _, symbol = scale_shown(quantity, found[0].unit)
    cells = {(each.at["axis"], each.at["toward"]): shown(each) for each in found}
    set_c = found[0].at["temperature_set_c"]
    return Sheet(
        title,
        tr("At the first set point, {set_c} °C; a row for each sensor, 95 %.",
           set_c="–" if set_c is None else f"{set_c:g}"),
        (("", ""), *((axis, symbol) for axis in AXES)),
        tuple((axis, *(cells.get((axis, other), "–") for other in AXES)) for axis in AXES),
    )  # fmt: skip


def _over_temperature(unit: UnitResult, detail: ImuDetail, pair: tuple[str, str], name: str) -> Plot:
    """Zero and scale factor with their knots, and below the interpolation error of knots left out."""
    figure = new_figure(5.4)
    panels = figure.subplots(2, 2, sharex="col", gridspec_kw={"hspace": 0.42, "wspace": 0.32})
    for column, quantity in enumerate(pair):
        above, below = panels[0][column], panels[1][column]
        factor, symbol = scale_shown(f"{quantity}/change", CHANGES[quantity][0])
        for axis, letter in enumerate(AXES):
            temperature_c, values = detail.curves[quantity, axis]
            if len(temperature_c) < 2:
                continue
            start = _at_first(unit, quantity, letter, values)
            scale = factor / start if quantity in RELATIVE else factor
            expanded = _expanded(unit, f"{quantity}/change", letter) * factor
            _draw(above, temperature_c, (values - start) * scale, expanded, letter, "-")
            if len(temperature_c) > 2:
                at_c = temperature_c[1:-1] + (axis - 1) * BESIDE * np.ptp(temperature_c)
                expanded = _expanded(unit, f"{quantity}/interpolation", letter) * factor
                _draw(below, at_c, check_model(temperature_c, values).error * scale, expanded, letter, "none")
        above.set(title=tr("{quantity}: without compensation", quantity=quantity), ylabel=f"Δ{quantity} / {symbol}")
        below.set_title(tr("{quantity}: a knot interpolated from its neighbours", quantity=quantity))
        below.set_ylabel(f"{tr('error')} / {symbol}")
        below.axhline(0, color="#444444", linewidth=0.6)
        below.set_visible(len(below.lines) > 1)
        below.set_xlabel(temperature_label())
    panels[0][0].legend()
    accelerometers = pair[0] == "K0"
    title = (
        tr("Accelerometers over temperature, before and after compensation")
        if accelerometers
        else tr("Gyros over temperature, before and after compensation")
    )
    caption = tr(
        "Above: the change relative to the first set point; the lines are the compensation, straight between the "
        "knots. "
        "Below: each inner knot left out and interpolated from its neighbours, the axes side by side; about four times "
        "the error of the compensation between knots. Bars: expanded uncertainty, 95 %, of the readings; all other "
        "contributions "
        "are common to the visits."
    )
    return Plot(title, rendered(figure, name, title), caption)


def _at_first(unit: UnitResult, quantity: str, letter: str, values: Array) -> float:
    """Value at the first set point."""
    found = (each for each in unit.findings if each.quantity == quantity and each.at.get("axis") == letter)
    return next((each.value for each in found if "visit" in each.at), float(np.mean(values)))


def _expanded(unit: UnitResult, quantity: str, letter: str) -> float:
    """Expanded uncertainty of the results of an axis over the run, which is that of each knot; 0 without it."""
    found = (each for each in unit.findings if each.quantity == quantity and each.at.get("axis") == letter)
    return next((each.expanded for each in found), 0.0)


def _draw(axes: Axes, temperature_c: Array, values: Array, expanded: float, letter: str, line: str) -> None:
    colour, marker = STYLES[letter]
    axes.errorbar(
        temperature_c, values, expanded, color=colour, marker=marker, markersize=3.5, linestyle=line, linewidth=0.9,
        elinewidth=0.8, capsize=2.5, label=letter,
    )  # fmt: skip


def visits(data: RunData) -> Iterator[Span]:
    """Visits of set points, by their temperatures."""
    return over_groups(data, lambda _number, members: in_unit(members[0].set_c, "°C"))
