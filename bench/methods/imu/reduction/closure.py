"""Stability check of an inertial unit and its table, start against end of a run.

The unit has one axis up at opposite headings, at the beginning and again at the end. For a level accelerometer half the
sum of two opposite readings is its bias, half their difference the tilt of the table along it, as at 0° and 180° of a
head. Contributions common to both times, such as misalignments, cancel in the changes, and so do the errors of a table
that reaches an attitude by the same angles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.imu.reduction.dead_band import is_near_zero
from bench.methods.imu.reduction.table_errors import table_errors
from bench.metrology.acquisition import Acquisition
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import LinearFit, NotDetermined, least_squares
from bench.metrology.orientation import unit_axes
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import AXES, RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

LEVEL = 0.1  # of g along an axis that counts as level
DIRECTIONS = ("east", "north")
READINGS = "readings: scatter pooled over the run"
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Properties of one accelerometer: pulse/s per g, scatter in pulse/s with degrees of freedom, g/°C of its bias.

    `dead_band_g` is that of its converter, 0 without one.
    """

    per_g: float
    scatter: float
    dof: int
    bias_g_per_c: float
    dead_band_g: float = 0.0


@dataclass(frozen=True, slots=True)
class _Entry:
    """Check at one time: biases in g by axis, tilts in rad by direction, and the data they come from.

    `temperatures_c` are those of the thermometers of its axes, `at_s` is the mean bench time of its windows.

    A reading is of a window and an axis; `fit` has the biases of `axes`, then the tilts.
    """

    fit: LinearFit
    axes: tuple[int, ...]
    readings: tuple[tuple[Acquisition, int], ...]
    temperatures_c: Mapping[int, float]
    at_s: float

    @property
    def names(self) -> list[tuple[str, str]]:
        """Quantity and axis or direction of each coefficient."""
        return [("K0", AXES[axis]) for axis in self.axes] + [("level", each) for each in DIRECTIONS]


def closure_findings(data: RunData, unit: UnitUnderTest, sensitive: Mapping[int, Sensitivity]) -> Iterator[Finding]:
    """Change of each bias and of the level between the first and the last check, in each mount of the unit.

    `sensitive` are the accelerometers by their axes. Empty with a single check.
    """
    by_mount: dict[str, dict[str, list[Acquisition]]] = {}
    for acquisition in data.closure:
        by_mount.setdefault(acquisition.mount.name, {}).setdefault(acquisition.group, []).append(acquisition)
    for mount, groups in by_mount.items():
        windows = list(groups.values())
        first, last = (_entry(each, unit, data.bench, sensitive) for each in (windows[0], windows[-1]))
        if len(windows) > 1 and first is not None and last is not None and first.names == last.names:
            suffix = f"@{mount}" if len(by_mount) > 1 else ""
            yield from _changes(data, unit, sensitive, first, last, suffix)


def _entry(
    windows: Sequence[Acquisition], unit: UnitUnderTest, bench: BenchRecord, sensitive: Mapping[int, Sensitivity]
) -> _Entry | None:
    """Check from the windows of one time; None if they determine nothing, as without opposite headings.

    Also None without a calibrated accelerometer, if a run ended before its first set point.
    """
    rows, values_g, readings = [], [], []
    for window in windows:
        lies = unit_axes(window, unit, bench)
        for axis, known in sensitive.items():
            counted = window.windows[unit.channels[f"acc_{AXES[axis]}"]]
            if abs(lies[axis, 2]) < LEVEL and not set(counted.problems) - {"dead_band"}:
                rows.append((axis, lies[axis, :2]))
                values_g.append(counted.mean / known.per_g)
                readings.append((window, axis))
    if not rows:
        return None
    axes = tuple(sorted({axis for axis, _ in rows}))
    design = [[*(float(axis == each) for each in axes), *level] for axis, level in rows]
    try:
        fit = least_squares(np.array(design).reshape(len(rows), -1), np.array(values_g))
    except NotDetermined:
        return None
    temperatures_c = {axis: _mean_c(windows, _thermometer(unit, axis)) for axis in axes}
    at_s = float(np.mean([(window.begin_s + window.end_s) / 2 for window in windows]))
    return _Entry(fit, axes, tuple(readings), temperatures_c, at_s)


def _thermometer(unit: UnitUnderTest, axis: int) -> str:
    return unit.thermometer(f"acc_{AXES[axis]}")


def _mean_c(windows: Sequence[Acquisition], thermometer: str) -> float:
    read_c = np.concatenate([window.temperatures_c.get(thermometer, np.empty(0)) for window in windows])
    return float(np.nanmean(read_c)) if np.isfinite(read_c).any() else math.nan


def _changes(
    data: RunData, unit: UnitUnderTest, sensitive: Mapping[int, Sensitivity], first: _Entry, last: _Entry, suffix: str
) -> Iterator[Finding]:
    steps = tuple(dict.fromkeys(window.step for entry in (first, last) for window, _ in entry.readings))
    for index, (quantity, of) in enumerate(first.names):
        change = float(last.fit.coefficients[index] - first.fit.coefficients[index])
        lines = [*_scatter(first, last, index, sensitive), *_of_table(first, last, index, unit, data.bench)]
        lines += _dead_bands(first, last, index, unit, sensitive)
        at: dict[str, str] = {"direction": of}
        name = "change of the tilt of the table from the beginning of the run to its end; positive raises that side"
        if quantity == "K0":
            axis = AXES.index(of)
            per_c, drift = sensitive[axis].bias_g_per_c, DriftInRun(data, _thermometer(unit, axis))
            warmer_c = last.temperatures_c[axis] - first.temperatures_c[axis]
            if math.isfinite(per_c * warmer_c):
                change -= per_c * warmer_c
                drifted_c = float(np.diff(drift.error_c(np.array([first.at_s, last.at_s])))[0])
                lines.append(drift.line(per_c * drifted_c))
            at = {"axis": of}
            name = "change of the bias from the beginning of the run to its end, brought to one temperature"
        subject, symbol = data.subject(unit).part(of), "g" if quantity == "K0" else "rad"
        yield subject.finding(f"{quantity}/closure", name, change, symbol, lines, at, steps, suffix)


def _scatter(first: _Entry, last: _Entry, index: int, sensitive: Mapping[int, Sensitivity]) -> Iterator[BudgetLine]:
    """Contribution of the scatter of both times."""
    square, dofs = 0.0, [1]
    for entry in (first, last):
        for weight, (_, axis) in zip(entry.fit.gain[index], entry.readings, strict=True):
            known = sensitive[axis]
            square += (float(weight) * known.scatter / known.per_g) ** 2
            dofs.append(known.dof)
    yield BudgetLine(READINGS, "A", math.sqrt(square), max(dofs))


def _dead_bands(
    first: _Entry, last: _Entry, index: int, unit: UnitUnderTest, sensitive: Mapping[int, Sensitivity]
) -> Iterator[BudgetLine]:
    """Lines of the accelerometers near zero: at each time the input may be anywhere in the dead band (rectangular)."""
    for axis, known in sensitive.items():
        channel, square = unit.channels[f"acc_{AXES[axis]}"], 0.0
        for entry in (first, last):
            weight = math.fsum(
                float(each)
                for each, (window, of) in zip(entry.fit.gain[index], entry.readings, strict=True)
                if of == axis and is_near_zero(window.windows[channel], known.per_g, known.dead_band_g)
            )
            square += (weight * known.dead_band_g) ** 2 / 3
        if square:
            yield BudgetLine(f"{channel}: dead band", "B", math.sqrt(square))


def _of_table(first: _Entry, last: _Entry, index: int, unit: UnitUnderTest, bench: BenchRecord) -> Iterator[BudgetLine]:
    """Contribution of table errors to a change: zero if an attitude is reached by the same angles both times."""
    windows = list({window.step: window for entry in (first, last) for window, _ in entry.readings}.values())
    number = {window.step: row for row, window in enumerate(windows)}
    weights = np.zeros((len(windows), len(AXES)))
    for entry, sign in ((first, -1.0), (last, 1.0)):
        for weight, (window, axis) in zip(entry.fit.gain[index], entry.readings, strict=True):
            weights[number[window.step], axis] += sign * weight
    errors = table_errors(windows, unit, bench)
    effects = [np.sum(weights * source.seen(errors.axes, UP), axis=-1) for source in errors.sources]
    yield from errors.lines(effects, np.ones(len(windows)))
