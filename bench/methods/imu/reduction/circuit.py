"""Temperature circuit of a unit: its output at the nominal temperature, and its deviation from a thermometer.

The output is read in every window of the visits, and so is the thermometer that it is compared with. Straight lines
between the visits give the output at the nominal temperature, as for the sensors (equations 4.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.imu.reduction.budget import READINGS
from bench.methods.imu.reduction.knots import TemperatureTable, temperature_table
from bench.methods.imu.reduction.windows import Visit, mean_c
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import RunData, TemperatureCircuit, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

NOMINAL = "output of the temperature circuit at the nominal temperature"
DEVIATION = "temperature by the temperature circuit less that of the thermometer, at the nominal set point"


@dataclass(frozen=True, slots=True)
class _Read:
    """Windows of one visit, (n,) each: bench time, temperature by the reference, output of the circuit."""

    at_s: Array
    reference_c: Array
    output: Array

    @property
    def mean(self) -> tuple[float, float]:
        """Mean temperature and output."""
        return float(self.reference_c.mean()), float(self.output.mean())


def circuit_findings(
    data: RunData, unit: UnitUnderTest, visits: Sequence[Visit], nominal_visits: Sequence[int], nominal_c: float | None
) -> Iterator[Finding]:
    """Output at the nominal temperature, and deviation; empty without a circuit or its readings.

    The nominal temperature is `nominal_c`, or the mean of the reference over the `nominal_visits`. Nothing is found for
    one that was not reached.
    """
    circuit = unit.circuit
    read = {visit.number: found for visit in visits if circuit and len((found := _read(visit, circuit)).at_s) > 1}
    at_nominal = [number for number in nominal_visits if number in read]
    if circuit is None or not at_nominal:
        return
    table = temperature_table(np.array([(*each.mean, 1.0) for each in read.values()]))
    if nominal_c is None:
        nominal_c = float(np.mean([read[number].mean[0] for number in at_nominal]))
    slopes = _slopes(table)
    sd, dof = _scatter(list(read.values()), table, slopes)
    subject, steps = data.subject(unit), tuple(each.step for number in at_nominal for each in visits[number].windows)
    windows = np.concatenate([read[number].at_s for number in at_nominal])
    drift = DriftInRun(data, circuit.reference)
    drifted_c = float(np.mean(drift.error_c(windows)))
    at = {"temperature_c": nominal_c, "temperature_u_c": data.bench.temperature_u_c(circuit.reference, nominal_c)}

    def lines(scatter: float, per_c: float) -> list[BudgetLine]:
        return [
            BudgetLine(READINGS, "A", abs(scatter), dof or None),
            data.bench.temperature(circuit.reference, nominal_c).times(per_c),
            drift.line(per_c * drifted_c),
        ]

    alone = sd / math.sqrt(len(windows))
    if table.temperature_c[0] <= nominal_c <= table.temperature_c[-1]:
        value = float(np.interp(nominal_c, table.temperature_c, table.zero))
        slope = float(np.interp(nominal_c, table.temperature_c, slopes))
        yield subject.finding("circuit/nominal", NOMINAL, value, circuit.unit, lines(alone, slope), at, steps)
    apart_c = np.concatenate([circuit.indicated_c(read[n].output) - read[n].reference_c for n in at_nominal])
    if np.isfinite(apart_c).all():
        indicated = 1.0 if circuit.unit == "°C" else circuit.slope
        mean_at = {"temperature_c": float(np.mean([read[number].mean[0] for number in at_nominal]))}
        yield subject.finding(
            "circuit/deviation", DEVIATION, float(apart_c.mean()), "°C", lines(alone / indicated, 1.0), at | mean_at,
            steps,
        )  # fmt: skip


def _read(visit: Visit, circuit: TemperatureCircuit) -> _Read:
    """Windows of a visit in which most readings of both are good."""
    rows = [
        ((each.begin_s + each.end_s) / 2, *(mean_c(each, name) for name in (circuit.reference, circuit.output)))
        for each in visit.windows
    ]
    columns = np.array(rows, np.float64).reshape(-1, 3)
    return _Read(*columns[np.isfinite(columns).all(axis=-1)].T)


def _slopes(table: TemperatureTable) -> Array:
    """Slope of the output at each knot; 0 with a single one."""
    return np.gradient(table.zero, table.temperature_c) if table.usable else np.zeros_like(table.zero)


def _scatter(read: Sequence[_Read], table: TemperatureTable, slopes: Array) -> tuple[float, int]:
    """Standard deviation of the outputs of windows about their visits, brought to one temperature; its dof."""
    squares, dof = 0.0, 0
    for each in read:
        away_c = each.reference_c - each.reference_c.mean()
        slope = np.interp(each.reference_c.mean(), table.temperature_c, slopes)
        squares += float(np.sum((each.output - each.output.mean() - slope * away_c) ** 2))
        dof += len(each.output) - 1
    return math.sqrt(squares / dof), dof
