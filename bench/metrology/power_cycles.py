"""Repeatability over power cycles in the budgets of results that combine data from before and after an interruption.

After a power cycle a unit has another bias and scale factor, by its stated repeatability. The run is reduced again with
the outputs of one stretch between interruptions shifted by one standard deviation, for each stretch and each sensor.
The change of a result is its contribution: one mechanism for all methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from bench.metrology.acquisition import Acquisition, Shift
from bench.metrology.results.budget import BudgetLine, combined
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.limits import U_UNKNOWN
from bench.metrology.run_data import RunData, UnitUnderTest

T = TypeVar("T")

SOURCE = "power cycles: repeatability of the unit"
OF_GYROS = ("D0", "KG", "gyro_", "g_sensitivity")  # quantities of the gyros of an inertial unit
DEPENDS = 1e-6  # relative to the largest change of a result; smaller changes are rounding
Reduce = Callable[[RunData, Mapping[str, Any]], Sequence[UnitResult]]
Shifts = Mapping[str, Shift]


@dataclass(frozen=True, slots=True)
class _Sensor:
    """A sensor of a unit: source of its output, shifts of bias and scale, and scale factor.

    `per_input` is in output units per g or °/s, NaN if neither determined by the run nor stated.
    """

    measured_by: str
    bias: float
    scale: float
    per_input: float

    def shifts(self) -> Iterator[Shift]:
        """Shifts of the bias and of the scale factor, as far as stated."""
        if self.bias:
            yield Shift(more=self.bias * self.per_input)
        if self.scale:
            yield Shift(times=1 + self.scale)


def reduced(reduce: Reduce, data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run, with a line for power cycles where a result combines stretches and the repeatability is stated."""
    found = list(reduce(data, settings))
    stretches = sorted({each.stretch for each in (*data.acquisitions, *data.closure)})
    if len(stretches) < 2:
        return found
    by_place = {unit.place: unit for unit in data.units}
    return [_with_lines(each, by_place[each.place], reduce, data, settings, stretches) for each in found]


def _with_lines(
    result: UnitResult, unit: UnitUnderTest, reduce: Reduce, data: RunData, settings: Mapping[str, Any],
    stretches: Sequence[int],
) -> UnitResult:  # fmt: skip
    """Results of a unit, each with its line."""
    alone = replace(data, units=(unit,))
    changes: dict[str, dict[int, float]] = {finding.id: {} for finding in result.findings}
    sensors = list(_sensors(unit, result, settings))
    if any(sensor.bias and math.isnan(sensor.per_input) for sensor in sensors):
        unknown = dict.fromkeys(stretches, math.nan)
        return replace(result, findings=tuple(_with_line(each, unknown) for each in result.findings))
    for sensor in sensors:
        for shift in sensor.shifts():
            for stretch in stretches:
                (again,) = reduce(_shifted(alone, stretch, {sensor.measured_by: shift}), settings)
                now = {finding.id: finding.value for finding in again.findings}
                for finding in result.findings:
                    by = now.get(finding.id, math.nan) - finding.value
                    changes[finding.id][stretch] = math.hypot(changes[finding.id].get(stretch, 0.0), by)
    return replace(result, findings=tuple(_with_line(each, changes[each.id]) for each in result.findings))


def _with_line(finding: Finding, changes: Mapping[int, float]) -> Finding:
    """A finding with its line if it depends on more than one stretch; INVALID if the repeatability is not stated.

    A finding from one stretch alone describes the unit at that time, as in a run without interruptions.
    """
    sizes = changes.values()
    if any(math.isnan(size) for size in sizes):
        return replace(finding, verdict="INVALID", flags=(*finding.flags, U_UNKNOWN))
    if sum(size > DEPENDS * max(sizes) for size in sizes) < 2:
        return finding
    u = math.hypot(*sizes)
    interval = None if finding.interval is None else finding.interval.beside(u)
    return replace(finding, budget=combined([*finding.budget, BudgetLine(SOURCE, "B", u)]), interval=interval)


def _sensors(unit: UnitUnderTest, result: UnitResult, settings: Mapping[str, Any]) -> Iterator[_Sensor]:
    """Sensors of a unit with a stated repeatability; gyros only if there are results of them."""
    stated = unit.power_cycles
    if stated is None:
        return
    accelerometer, gyro = (stated.bias_g, stated.scale), (stated.gyro_bias_dps, stated.gyro_scale)
    channels = unit.channels or {"acc" if stated.bias_g is not None else "gyro": unit.measured_by}
    of_gyros = not unit.channels or any(finding.quantity.startswith(OF_GYROS) for finding in result.findings)
    for name, measured_by in channels.items():
        kind, _, axis = name.partition("_")
        if kind == "gyro" and not of_gyros:
            continue
        bias, scale = accelerometer if kind == "acc" else gyro
        per_input = _per_input(unit, result, settings, "K1" if kind == "acc" else "KG", axis)
        yield _Sensor(measured_by, bias or 0.0, scale or 0.0, per_input)


def _per_input(unit: UnitUnderTest, result: UnitResult, settings: Mapping[str, Any], quantity: str, axis: str) -> float:
    """Scale factor of a sensor: as determined, else as stated by the sequence or the bench file; NaN if none."""
    place = f"{unit.place}/{axis}" if axis else unit.place
    found = [
        abs(finding.value)
        for finding in result.findings
        if finding.quantity == quantity and f"/{place}/" in finding.id and math.isfinite(finding.value)
    ]
    if found:
        return math.fsum(found) / len(found)
    scale = settings.get("scale")
    if isinstance(scale, Mapping) and unit.output_unit in scale:
        return abs(float(scale[unit.output_unit]))
    return abs(unit.nominal_per_g) if quantity == "K1" and unit.nominal_per_g is not None else math.nan


def _shifted(data: RunData, stretch: int, shifts: Shifts) -> RunData:
    """Data with the outputs of one stretch shifted."""
    acquisitions, closure = (
        tuple(_changed(each, shifts) if each.stretch == stretch else each for each in part)
        for part in (data.acquisitions, data.closure)
    )
    return replace(data, acquisitions=acquisitions, closure=closure)


def _changed(acquisition: Acquisition, shifts: Shifts) -> Acquisition:
    def changed(found: Mapping[str, T], change: Callable[[T, Shift], T]) -> dict[str, T]:
        return {key: change(each, shifts[key]) if key in shifts else each for key, each in found.items()}

    return replace(
        acquisition,
        counts=changed(acquisition.counts, lambda found, by: replace(found, shift=by)),
        voltages=changed(acquisition.voltages, lambda found, by: found._replace(values_v=by.of_each(found.values_v))),
        codes=changed(acquisition.codes, lambda found, by: replace(found, values=by.of_each(found.values))),
        windows=changed(acquisition.windows, lambda found, by: found._replace(mean=by.of(found.mean))),
    )
