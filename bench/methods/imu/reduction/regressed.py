"""Output of a sensor regressed to its nominal temperature: its change before, and what is left (equations 4.5).

    (N/t)_N = v K1(T_N) + K0(T_N),   v = (N/t - K0(T)) / K1(T)

N is the net output of an accelerometer at 1 g of either sign, W that of a gyro at the largest rate of the calibration.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.budget import READINGS, own_u, pooled_dof
from bench.methods.imu.reduction.calibrate import ImuCalibration
from bench.methods.imu.reduction.knots import TemperatureTable
from bench.methods.imu.reduction.records import ImuReadings
from bench.metrology.calibration.nominal_output import NominalOutput
from bench.metrology.extremes import interval_of_largest
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Interval, Subject
from bench.metrology.run_data import AXES, UnitUnderTest

QUANTITIES = {"acc": ("N", "K0", "K1"), "gyro": ("W", "D0", "KG")}
NAMES = {
    "N/change": "largest change of the output over temperature, at 1 g of either sign, without compensation",
    "N/left": "largest error of the regressed output, at 1 g of either sign, at a temperature that was left out: about "
    "four times what compensation leaves",
    "W/change": "largest change of the output over temperature, at the largest rate of either sign, without "
    "compensation",
    "W/left": "largest error of the regressed output, at the largest rate of either sign, at a temperature that was "
    "left out: about four times what compensation leaves",
}


@dataclass(frozen=True, slots=True)
class Regressed:
    """Output of one sensor over temperature: its table, nominal temperature, largest input, and own u of its constants.

    `own_zero` and `own_scale` are standard uncertainties of zero and scale factor of a visit by the readings alone,
    `visits` (k,) the numbers of visits that are averaged in the knots.
    """

    table: TemperatureTable
    nominal_c: float
    largest: float
    own_zero: float
    own_scale: float
    visits: NDArray[np.int_]

    @property
    def is_known(self) -> bool:
        """True if the nominal temperature is between the knots."""
        return self.table.usable and bool(self.table.covers(np.array(self.nominal_c)))

    @property
    def own(self) -> float:
        """Standard uncertainty of an output at the largest input by the readings alone."""
        return math.hypot(self.own_zero, self.largest * self.own_scale)

    def change(self) -> tuple[float, float, Interval]:
        """Largest deviation of the outputs at the knots from that at the nominal temperature."""
        return self._largest(self._outputs(self.table) - self._at_nominal(self.table), math.sqrt(2) * self.own)

    def left(self) -> tuple[float, float, Interval] | None:
        """Largest deviation of the output at an inner knot, regressed by the others; None without an inner knot.

        The nominal output is that of the whole table, unless the knot at the nominal temperature itself is left out.
        """
        inner = range(1, len(self.table.temperature_c) - 1)
        found = [self._left_at(number) for number in inner]
        return self._largest(np.array(found), math.sqrt(1.5) * self.own) if found else None

    def _left_at(self, number: int) -> Array:
        """Error of the regressed output of a knot by a table without it, for both inputs (2,)."""
        table = self.table
        others = TemperatureTable(*(np.delete(each, number) for each in (table.temperature_c, table.zero, table.scale)))
        zero, scale = others.at(table.temperature_c[number : number + 1], "hold")
        value = (self._outputs(table)[number] - zero) / scale
        return np.asarray((value - self._inputs) * self._nominal(table)[1])

    @property
    def nominal_scale(self) -> float:
        """Scale factor at the nominal temperature."""
        return float(self._nominal(self.table)[1][0])

    @property
    def _inputs(self) -> Array:
        return np.array([1.0, -1.0]) * self.largest

    def _outputs(self, table: TemperatureTable) -> Array:
        """Outputs at the knots for both inputs, (k, 2)."""
        return np.asarray(table.zero[:, np.newaxis] + table.scale[:, np.newaxis] * self._inputs)

    def _nominal(self, table: TemperatureTable) -> tuple[Array, Array]:
        return table.at(np.array([self.nominal_c]), "hold")

    def _at_nominal(self, table: TemperatureTable) -> Array:
        zero, scale = self._nominal(table)
        return np.asarray(zero + scale * self._inputs)

    def _largest(self, deviations: Array, u: float) -> tuple[float, float, Interval]:
        """Largest of deviations (k, 2), its standard uncertainty, and its interval."""
        worst = deviations[np.arange(len(deviations)), np.argmax(np.abs(deviations), axis=-1)]
        return float(np.max(np.abs(worst))), u, interval_of_largest(worst, u)


def nominal_of(found: ImuCalibration, sensor: str, axis: int, visits: Sequence[int], nominal_c: float | None) -> float:
    """Nominal temperature of a sensor: as stated, or the mean by its thermometer over the nominal visits; else NaN."""
    if nominal_c is not None:
        return nominal_c
    there = [one for number in visits if (one := found.points[number].axes[axis]) is not None]
    known = [read_c for one in there if math.isfinite(read_c := one.temperature_c(sensor))]
    return float(np.mean(known)) if known else math.nan


def outputs_of(
    found: ImuCalibration,
    readings: ImuReadings,
    at_visits: Sequence[Finding],
    nominal_visits: Sequence[int],
    nominal_c: float | None,
) -> dict[tuple[str, int], Regressed]:
    """Outputs over temperature by sensor and axis; of those with two knots or more."""
    outputs = {}
    for (sensor, (_, zero_of, scale_of)), (axis, name) in product(QUANTITIES.items(), enumerate(AXES)):
        table = found.knots(sensor, axis)
        own = [each for each in at_visits if each.at["axis"] == name]
        zeros, scales = ([each for each in own if each.quantity == quantity] for quantity in (zero_of, scale_of))
        if table.usable and zeros and scales:
            rates_dps = np.concatenate([point[axis].rate_dps for point in readings.rates])
            outputs[sensor, axis] = Regressed(
                table=table,
                nominal_c=nominal_of(found, sensor, axis, nominal_visits, nominal_c),
                largest=1.0 if sensor == "acc" else float(np.max(np.abs(rates_dps))),
                own_zero=max(map(own_u, zeros)) * float(np.max(np.abs(table.scale))),
                own_scale=max(map(own_u, scales)),
                visits=visits_at(table.temperature_c, found.temperatures_c(sensor, axis)),
            )
    return outputs


def visits_at(knots_c: Array, visits_c: Array) -> NDArray[np.int_]:
    """Numbers (k,) of visits nearest to each knot, one at least."""
    nearest = np.argmin(np.abs(visits_c[:, np.newaxis] - knots_c), axis=-1)
    return np.maximum(np.bincount(nearest, minlength=len(knots_c)), 1)


def regressed_findings(
    subject: Subject, unit: UnitUnderTest, outputs: Mapping[tuple[str, int], Regressed], at_visits: Sequence[Finding]
) -> Iterator[Finding]:
    """Yield the change of each output over temperature and its error once regressed, if the nominal one is known."""
    for (sensor, axis), output in outputs.items():
        of = [e for e in at_visits if e.at["axis"] == AXES[axis] and e.quantity in QUANTITIES[sensor]]
        output_unit = unit.output_unit if sensor == "acc" else unit.gyro_output_unit
        steps = tuple(dict.fromkeys(step for each in of for step in each.steps))
        at = {"axis": AXES[axis], "temperature_c": output.nominal_c}
        for quantity, value, u, interval in described(output, sensor) if output.is_known else ():
            lines = [BudgetLine(READINGS, "A", u, pooled_dof(of))]
            yield subject.part(AXES[axis]).finding(
                quantity, NAMES[quantity], value, output_unit, lines, at, steps, interval=interval
            )


def nominal_output(regressed: Regressed, sensor: str, over_temperature: Mapping[str, float]) -> NominalOutput | None:
    """Nominal temperature and uncertainties of a regressed output, for the user of the unit; None if not known.

    `over_temperature` has the largest differences of visits and the errors of knots left out, by quantity; as much of
    them as scatter alone makes is left out. Compensation leaves about a quarter of the error of a knot left out.
    """
    if not regressed.is_known:
        return None
    _, zero_of, scale_of = QUANTITIES[sensor]
    scale = abs(regressed.nominal_scale)

    def beside(quantity: str, own: float) -> float:
        apart, left = (over_temperature.get(f"{quantity}/{what}", 0.0) for what in ("repeatability", "interpolation"))
        # Products: beyond the range of a float they are infinite, where a power raises OverflowError.
        of_visits, of_line = apart * apart - 2 * own * own, left * left - 1.5 * own * own
        return math.sqrt((max(of_visits, 0.0) + max(of_line, 0.0) / 16) / 3)

    per_knot = 1 / np.sqrt(regressed.visits)
    return NominalOutput(
        at_c=regressed.nominal_c,
        offset_u=tuple((regressed.own_zero * per_knot).tolist()),
        scale_u=tuple((regressed.own_scale * per_knot).tolist()),
        offset_beside_u=scale * beside(zero_of, regressed.own_zero / scale),
        scale_beside_u=scale * beside(scale_of, regressed.own_scale / scale),
    )


def left_outs(findings: Sequence[Finding], axis: str) -> dict[str, float]:
    """Values of the results over temperature of an axis, by quantity."""
    return {each.quantity: each.value for each in findings if each.at.get("axis") == axis and "visit" not in each.at}


def described(regressed: Regressed, sensor: str) -> Iterator[tuple[str, float, float, Interval]]:
    """Quantity, value, standard uncertainty and interval of each result on the regressed output of a sensor."""
    symbol = QUANTITIES[sensor][0]
    yield f"{symbol}/change", *regressed.change()
    if (left := regressed.left()) is not None:
        yield f"{symbol}/left", *left
