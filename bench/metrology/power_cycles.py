"""Repeatability over power cycles in the budgets of results from both sides of an interruption of their run.

A unit that was without power in between has another bias and scale factor after it, by as much as is stated of it. The
run is reduced again with the outputs of one stretch between interruptions shifted by one standard deviation, for each
stretch and each sensor. By how much a result changes is what that contributes to it: one mechanism for all methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.metrology.acquisition import Acquisition, Codes, Counts, Shift, Voltages, Window
from bench.metrology.results.budget import BudgetLine, combined
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.results.limits import U_UNKNOWN
from bench.metrology.run_data import RunData, UnitUnderTest

SOURCE = "power cycles: repeatability of the unit"
DEPENDS = 1e-6  # of the largest change of a result: what is less is rounding
Reduce = Callable[[RunData, Mapping[str, Any]], Sequence[UnitResult]]
Shifts = Mapping[str, Shift]


@dataclass(frozen=True, slots=True)
class _Sensor:
    """A sensor of a unit: what measures its output, by what its bias and scale shift, and its scale factor.

    `per_input` is in output units per g or °/s, NaN where the run does not determine it and nobody says.
    """

    measured_by: str
    bias: float
    scale: float
    per_input: float

    def shifts(self) -> Iterator[Shift]:
        """A shift of the bias and one of the scale factor, as far as there is any."""
        if self.bias:
            yield Shift(more=self.bias * self.per_input)
        if self.scale:
            yield Shift(times=1 + self.scale)


def reduced(reduce: Reduce, data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """What a method finds, with a line for power cycles where a result combines stretches and the line is stated."""
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
    """The results of a unit, each with its line."""
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
    """A finding with its line where it changes with more than one stretch; INVALID where that is not known.

    A finding from one stretch alone is of the unit as it was then, as in a run that nothing has interrupted.
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
    """The sensors of a unit of which something is stated."""
    stated = unit.power_cycles
    if stated is None:
        return
    accelerometer, gyro = (stated.bias_g, stated.scale), (stated.gyro_bias_dps, stated.gyro_scale)
    channels = unit.channels or {"acc" if stated.bias_g is not None else "gyro": unit.measured_by}
    for name, measured_by in channels.items():
        kind, _, axis = name.partition("_")
        bias, scale = accelerometer if kind == "acc" else gyro
        per_input = _per_input(unit, result, settings, "K1" if kind == "acc" else "KG", axis)
        yield _Sensor(measured_by, bias or 0.0, scale or 0.0, per_input)


def _per_input(unit: UnitUnderTest, result: UnitResult, settings: Mapping[str, Any], quantity: str, axis: str) -> float:
    """The scale factor of a sensor: as found, else as the sequence or the bench file states it; NaN for none."""
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
    """The data with the outputs of one stretch shifted."""
    acquisitions, closure = (
        tuple(_changed(each, shifts) if each.stretch == stretch else each for each in part)
        for part in (data.acquisitions, data.closure)
    )
    return replace(data, acquisitions=acquisitions, closure=closure)


def _changed(acquisition: Acquisition, shifts: Shifts) -> Acquisition:
    """An acquisition with other outputs."""
    return replace(
        acquisition,
        counts={key: _counts(each, shifts.get(key)) for key, each in acquisition.counts.items()},
        voltages={key: _voltages(each, shifts.get(key)) for key, each in acquisition.voltages.items()},
        codes={key: _codes(each, shifts.get(key)) for key, each in acquisition.codes.items()},
        windows={key: _window(each, shifts.get(key)) for key, each in acquisition.windows.items()},
    )


def _counts(found: Counts, shift: Shift | None) -> Counts:
    return found if shift is None else replace(found, shift=shift)


def _voltages(found: Voltages, shift: Shift | None) -> Voltages:
    return found if shift is None else replace(found, values_v=shift.of_each(found.values_v))


def _codes(found: Codes, shift: Shift | None) -> Codes:
    return found if shift is None else replace(found, values=shift.of_each(found.values))


def _window(found: Window, shift: Shift | None) -> Window:
    return found if shift is None else replace(found, mean=shift.of(found.mean))
