"""Method M2 on a run: an inertial unit calibrated at every set point, and compensated (equations 4).

Type A is the scatter of the readings about their fits, pooled over the run; type B is from the certificates of the
bench, through the effect of each table error on each attitude. The temperature is that of the unit's thermometers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitude_fit import AttitudeFits, fit_attitudes
from bench.methods.imu.reduction.attitudes import NAMES
from bench.methods.imu.reduction.budget import READINGS, own_u, pooled_dof
from bench.methods.imu.reduction.calibrate import AxisCalibration, ImuCalibration, calibrate, thermometers_apart
from bench.methods.imu.reduction.circuit import circuit_findings
from bench.methods.imu.reduction.closure import Sensitivity, closure_findings
from bench.methods.imu.reduction.dead_band import dead_band_of, near_zero, near_zero_flags
from bench.methods.imu.reduction.findings import AxisAtVisit
from bench.methods.imu.reduction.knots import SAME_KNOT_C, check_model
from bench.methods.imu.reduction.noise import noise_of
from bench.methods.imu.reduction.regressed import Regressed, outputs_of, regressed_findings
from bench.methods.imu.reduction.table_errors import table_errors
from bench.methods.imu.reduction.user_models import UserModels
from bench.methods.imu.reduction.visits import differences
from bench.methods.imu.reduction.windows import SAME_SET_POINT_C, readings, visits
from bench.methods.imu.words import NOMINAL_UNREACHED
from bench.metrology.extremes import interval_of_largest
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import NOT_CLOSED, Finding, Interval, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, RunData, UnitUnderTest

MODELLED = {"K0": "g", "K1": "1", "D0": "°/s", "KG": "1"}  # quantities over temperature, and the units of their changes
RELATIVE = ("K1", "KG")
OF_GYROS = ("D0", "KG")
LONG = {"K0": "bias", "K1": "scale factor of the accelerometer", "D0": "zero of the gyro", "KG": "scale factor"}


@dataclass(frozen=True, slots=True)
class ImuDetail:
    """Data for the report: the calibration, and the knots of each quantity of each axis.

    `curves` are temperature (k,), value (k,), by quantity and axis, `outputs` the regressed outputs by sensor and axis.
    """

    calibration: ImuCalibration
    curves: Mapping[tuple[str, int], tuple[Array, Array]]
    unit: UnitUnderTest
    outputs: Mapping[tuple[str, int], Regressed]


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the findings and models of every unit."""
    return [_Unit(data, unit, settings).result() for unit in data.units]


class _Unit:
    """Reduction of one unit."""

    def __init__(self, data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> None:
        self._data, self._unit, self._settings = data, unit, settings
        self._visits = visits(data, unit)
        self._readings = readings(self._visits, unit, settings["rate_tolerance"])
        self._found = calibrate(self._readings, settings["attitude_tolerance_g"], data.bench.latitude_deg)
        self._near_zero = [self._silent(number) for number in range(len(self._visits))]
        self._fits = [self._fitted(number) for number in range(len(self._visits))]
        gyros = [fits.gyros for _, fits in self._fits]
        self._noise = [
            noise_of(axis, unit, self._visits, self._readings, self._found, [each[axis] for each in gyros])
            for axis in range(len(AXES))
        ]
        self._curves = {
            (quantity, axis): _curve(self._found, quantity, axis) for quantity in MODELLED for axis in range(len(AXES))
        }

    def result(self) -> UnitResult:
        """All results of the unit."""
        at_visits = [finding for axis in self._at_visits() for finding in axis.findings()]
        over_temperature = list(self._over_temperature(at_visits))
        nominal_c = self._settings.get("nominal_c")
        outputs = outputs_of(self._found, self._readings, at_visits, self._nominal_visits, nominal_c)
        over_temperature += list(regressed_findings(self._data.subject(self._unit), self._unit, outputs, at_visits))
        user = UserModels(self._data, self._unit, self._found, at_visits, outputs)
        circuit = list(circuit_findings(self._data, self._unit, self._visits, self._nominal_visits, nominal_c))
        unplaced = [Flag("no_attitude", at=step) for visit in self._visits for step in visit.unplaced]
        closure = list(closure_findings(self._data, self._unit, dict(self._sensitive())))
        findings = [*at_visits, *over_temperature, *circuit, *closure]
        limits = {"K0/closure": self._settings["closure_limit_g"], "level/closure": self._settings["level_limit_rad"]}
        moved = list(dict.fromkeys(each.quantity for each in closure if abs(each.value) > limits[each.quantity]))
        if moved:
            findings = [each.flagged(NOT_CLOSED) for each in findings]
        return UnitResult(
            place=self._unit.place,
            uut=self._unit.serial,
            findings=tuple(findings),
            models=tuple(user.models()),
            left_out=tuple(self._left_out()),
            flags=(
                *self._found.flags,
                *self._found.notes,
                *self._near_zero_flags(),
                *self._unreached(outputs),
                *thermometers_apart(self._found, self._settings["gradient_limit_c"]),
                *unplaced,
                *(Flag("moved", of=quantity) for quantity in moved),
            ),
            detail=ImuDetail(self._found, self._curves, self._unit, outputs),
            compensations=tuple(user.compensations(over_temperature)),
        )

    def _sensitive(self) -> Iterator[tuple[int, Sensitivity]]:
        """Properties of the accelerometers calibrated at the beginning of the run, for its stability check."""
        for axis in range(len(AXES)):
            every, (scatter, dof) = self._found.over_temperature(axis), self._noise[axis].accelerometer
            if every:
                own_g = dead_band_of(self._unit, axis, self._settings["dead_band_g"])
                yield axis, Sensitivity(every[0].k1_per_g, scatter, dof, self._slope("K0", axis, every[0]), own_g)

    def _left_out(self) -> Iterator[str]:
        """Axes without a calibration at a set point."""
        for visit, point in zip(self._visits, self._found.points, strict=True):
            for name, axis in zip(AXES, point.axes, strict=True):
                if axis is None:
                    yield f"{visit.path}/{name}".strip("/")

    def _at_visits(self) -> Iterator[AxisAtVisit]:
        for number, (visit, point) in enumerate(zip(self._visits, self._found.points, strict=True)):
            used, fits = self._fits[number]
            windows = [visit.window_of(attitude) for attitude in range(len(NAMES))]
            any_other = next(filter(None, windows), None)
            there = [window or any_other for window in windows]
            errors = table_errors([each for each in there if each is not None], self._unit, self._data.bench)
            for axis, calibration in enumerate(point.axes):
                if calibration is not None:
                    yield AxisAtVisit(
                        subject=self._data.subject(self._unit),
                        unit=self._unit,
                        bench=self._data.bench,
                        visit=visit,
                        axis=axis,
                        calibration=calibration,
                        fits=fits,
                        noise=self._noise[axis],
                        slopes={quantity: self._slope(quantity, axis, calibration) for quantity in MODELLED},
                        per_c_u=self._per_c_u(calibration),
                        used=used[:, axis],
                        accelerometer_c=self._readings.accelerometer_c[number, :, axis],
                        gyro_c=self._readings.gyro_c[number, :, axis],
                        turned_s=self._readings.rates[number][axis].dwell_s,
                        errors=errors,
                    )

    def _fitted(self, number: int) -> tuple[NDArray[np.bool_], AttitudeFits]:
        """Fits over the attitudes of a visit without doubtful ones; mask of the readings used (24, 3)."""
        point = self._found.points[number]
        doubted = point.doubted[:, np.newaxis]
        left_out = doubted | self._near_zero[number]
        accelerometers = np.where(left_out, np.nan, self._readings.accelerometer_output[number])
        gyros = np.where(doubted, np.nan, self._readings.gyro_output[number])
        fits = fit_attitudes(accelerometers, gyros, self._data.bench.latitude_deg, point.pulse_per_deg)
        return np.isfinite(accelerometers), fits

    def _silent(self, number: int) -> NDArray[np.bool_]:
        """Mask of the readings of a visit (24, 3) that are in the dead band of their converter, or near it."""
        per_g = np.array([axis.k1_per_g if axis else np.nan for axis in self._found.points[number].axes])
        return near_zero(self._visits[number], self._unit, per_g, self._settings["dead_band_g"])

    def _near_zero_flags(self) -> Iterator[Flag]:
        for visit, silent in zip(self._visits, self._near_zero, strict=True):
            yield from near_zero_flags(visit.set_c, silent)

    def _per_c_u(self, calibration: AxisCalibration) -> dict[str, float]:
        """Standard uncertainty of each quantity per 1 °C, where the run does not determine its slope."""
        relative = self._settings["scale_per_c_u"]
        return {
            "K0": self._settings["bias_per_c_u"],
            "K1": relative * abs(calibration.k1_per_g),
            "D0": self._settings["gyro_bias_per_c_u"],
            "KG": relative * abs(calibration.kg_pulse_per_deg),
        }

    def _slope(self, quantity: str, axis: int, calibration: AxisCalibration) -> float:
        """Slope of a quantity over temperature at a set point, from knot to knot; NaN with a single one."""
        temperature_c, values = self._curves[quantity, axis]
        if len(temperature_c) < 2:
            return math.nan
        at_c = calibration.gyro_c if quantity in OF_GYROS else calibration.accelerometer_c
        return float(np.interp(at_c, temperature_c, np.gradient(values, temperature_c)))

    # Over temperature

    def _over_temperature(self, at_visits: Sequence[Finding]) -> Iterator[Finding]:
        for axis in range(len(AXES)):
            for quantity in MODELLED:
                found = [each for each in at_visits if each.quantity == quantity and each.at["axis"] == AXES[axis]]
                if found:
                    yield from self._of_quantity(quantity, axis, found)

    def _of_quantity(self, quantity: str, axis: int, found: Sequence[Finding]) -> Iterator[Finding]:
        """Change over temperature, interpolation error of the knots and repeatability at the first set point."""
        temperature_c, values = self._curves[quantity, axis]
        scale = 1 / found[0].value if quantity in RELATIVE else 1.0
        own = [own_u(each) for each in found]
        if len(temperature_c) > 1:
            start = np.interp(found[0].at["temperature_c"], temperature_c, values)
            farthest = int(np.argmax(np.abs(values - start)))
            change = abs(float(values[farthest] - start))
            name = f"largest change of the {LONG[quantity]} over temperature, without compensation"
            interval = interval_of_largest(values - start, math.sqrt(2) * own[0]).times(scale)
            u = math.sqrt(2) * own[0] * scale
            yield self._finding(f"{quantity}/change", axis, name, change * scale, u, found, interval)
        if len(temperature_c) > 2:
            error = check_model(temperature_c, values).error
            name = "largest error of a knot left out, told by its neighbours: about four times what compensation leaves"
            worst = float(np.max(np.abs(error)))
            u = math.sqrt(1.5) * max(own)
            interval = interval_of_largest(error, u).times(scale)
            yield self._finding(f"{quantity}/interpolation", axis, name, worst * scale, u * scale, found, interval)
        again = [each for each in found[1:] if _same_point(each, found[0])]
        if again:
            there = [found[0], *again]
            at_c, own_values = [each.at["temperature_c"] for each in there], [each.value for each in there]
            apart = differences(at_c, own_values, (temperature_c, values))
            largest = int(np.argmax(np.abs(apart)))
            us = np.hypot(own[0], [own_u(each) for each in again])
            name = "largest difference between visits of the first set point"
            both, u = [found[0], again[largest]], float(us[largest]) * scale
            interval = interval_of_largest(apart, us).times(scale)
            value = abs(float(apart[largest])) * scale
            yield self._finding(f"{quantity}/repeatability", axis, name, value, u, both, interval)

    # Regressed outputs

    @property
    def _nominal_visits(self) -> list[int]:
        """Visits of the first set point, which is the nominal one."""
        first = self._visits[0].set_c if self._visits else math.nan
        return [
            visit.number for visit in self._visits
            if visit.number == 0 or abs(visit.set_c - first) < SAME_SET_POINT_C
        ]  # fmt: skip

    def _unreached(self, outputs: Mapping[tuple[str, int], Regressed]) -> Iterator[Flag]:
        """Sensors whose nominal temperature is beyond their knots."""
        if names := [f"{sensor}_{AXES[axis]}" for (sensor, axis), each in outputs.items() if not each.is_known]:
            yield Flag(NOMINAL_UNREACHED, values={"sensors": ", ".join(names)})

    def _finding(
        self,
        quantity: str,
        axis: int,
        name: str,
        value: float,
        u: float,
        found: Sequence[Finding],
        interval: Interval,
    ) -> Finding:
        """A finding with the uncertainty of the readings: all other errors are common to the visits."""
        base = quantity.partition("/")[0]
        lines = [BudgetLine(READINGS, "A", abs(u), pooled_dof(found))]
        steps = tuple(dict.fromkeys(step for each in found for step in each.steps))
        subject = self._data.subject(self._unit).part(AXES[axis])
        return subject.finding(
            quantity, name, abs(value), MODELLED[base], lines, {"axis": AXES[axis]}, steps, interval=interval
        )


def _curve(found: ImuCalibration, quantity: str, axis: int) -> tuple[Array, Array]:
    """A quantity over temperature at the knots, temperature (k,) and value (k,)."""
    table = found.knots("gyro" if quantity in OF_GYROS else "acc", axis)
    if not len(table.temperature_c) or quantity in RELATIVE:
        return table.temperature_c, table.scale
    return table.temperature_c, np.asarray(table.zero / table.scale)


def _same_point(one: Finding, other: Finding) -> bool:
    apart_c = abs(one.at["temperature_c"] - other.at["temperature_c"])
    return bool(one.at["temperature_set_c"] == other.at["temperature_set_c"] or apart_c < SAME_KNOT_C)
