"""Findings of one axis of an inertial unit at one visit of a set point, each with its budget (equations 4.4)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitude_fit import AttitudeFits
from bench.methods.imu.reduction.attitudes import SPECIFIC_FORCE_G, block, local_earth_rate_dps
from bench.methods.imu.reduction.budget import (
    OwnErrors,
    gyro_scale_unit,
    harmonics_of_rates,
    rate_weights,
    scatter_line,
)
from bench.methods.imu.reduction.calibrate import AxisCalibration
from bench.methods.imu.reduction.noise import Noise, about_another
from bench.methods.imu.reduction.table_errors import Kind, TableErrors, table_errors
from bench.methods.imu.reduction.windows import Turning, Visit
from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import NotDetermined, least_squares
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject
from bench.metrology.run_data import AXES, UnitUnderTest
from bench.metrology.sampled_codes import quantisation_by_level

UP = np.array([0.0, 0.0, 1.0])
PARTIAL_TURNS = "earth rate in partial turns"
UNITS = {
    "K0": "g", "D0": "°/s", "K2": "g/g²", "misalignment": "rad", "gyro_misalignment": "rad", "g_sensitivity": "°/s/g",
}  # fmt: skip
NAMES = {
    "K0": "bias of the accelerometer, from the attitudes in which its axis is vertical",
    "K1": "scale factor of the accelerometer, per local g",
    "K1_si": "scale factor of the accelerometer, per m/s²",
    "D0": "zero of the gyro",
    "KG": "scale factor of the gyro",
    "K2": "second-order nonlinearity of the accelerometer, and the converter's asymmetry in it",
    "misalignment": "how much the accelerometer sees of another axis",
    "gyro_misalignment": "how much the gyro sees of a rate about another axis",
    "g_sensitivity": "what specific force along an axis adds to the gyro's rate",
}
CONTAINS = {
    "K0": ("contains:K2",), "K1": ("contains:K3",), "K1_si": ("contains:K3",), "K2": ("contains:asymmetry",),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class AxisAtVisit:
    """One axis at one visit, with all inputs of its budgets.

    `slopes` are those of K0, K1, D0 and KG over temperature, in their units, NaN if unknown, and `per_c_u` their
    standard uncertainties per 1 °C in that case; `used` (24,) masks the attitudes of the accelerometer in the fit over
    all of them. `accelerometer_c` and `gyro_c` (24,) are the temperatures in each attitude, which differ slightly from
    those of the findings: these are means over rates too. `turned_s` (r,) is the duration of each rate about the axis.
    `errors` are those of the table in all attitudes, of one of them for missing ones.
    """

    subject: Subject
    unit: UnitUnderTest
    bench: BenchRecord
    visit: Visit
    axis: int
    calibration: AxisCalibration
    fits: AttitudeFits
    noise: Noise
    slopes: Mapping[str, float]
    per_c_u: Mapping[str, float]
    used: NDArray[np.bool_]
    accelerometer_c: Array
    gyro_c: Array
    turned_s: Array
    errors: TableErrors

    def findings(self) -> Iterator[Finding]:
        """All findings of the axis."""
        yield from self._accelerometer()
        yield from self._gyro()
        yield from self._over_attitudes()
        yield from self._turned_about_others()

    # Means over the attitudes with the axis vertical

    def _accelerometer(self) -> Iterator[Finding]:
        one, k1 = self.calibration, self.calibration.k1_per_g
        gain = one.accelerometer.gain
        bias = gain[0] / k1 - one.k0 / k1**2 * gain[1]
        lines_k0, lines_k1 = self._of_accelerometer(self._own, k1, (bias, gain[1]))
        yield self._finding(
            "K0", one.k0 / k1, [
                *lines_k0, self._thermometer("K0", one.accelerometer_c),
                BudgetLine("K2 of the accelerometer: contained, inseparable in these attitudes", "alias", 0),
            ],
        )  # fmt: skip
        clock = self._of("acc").clock_of_scale(k1)
        scale = self._finding("K1", k1, [*lines_k1, *clock, self._thermometer("K1", one.accelerometer_c)])
        yield scale
        g = self.bench.gravity_mps2
        lines_si = [BudgetLine("K1", "B", scale.u / g, scale.dof, scale.id), self.bench.gravity(k1 / g)]
        yield self._finding("K1_si", k1 / g, lines_si)

    def _gyro(self) -> Iterator[Finding]:
        one, kg = self.calibration, self.calibration.kg_pulse_per_deg
        errors = self.errors.of(self._own)
        seen = errors.seen(local_earth_rate_dps(self.bench.latitude_deg), self.axis)
        zero_dps = one.d0 / kg
        gain = one.gyro_at_rest.gain[0]
        turning = one.gyro_turning.gain[1] / np.sqrt(self.turned_s)
        of_rates = scatter_line(self.noise.gyro_turning, turning * zero_dps / kg)
        lines = [
            scatter_line(self.noise.gyro_at_rest, gain / kg),
            of_rates._replace(source="readings of the rates: scatter", kind=""),
            *errors.lines(seen, gain),
            self._of("gyro").clock(zero_dps),
            self._thermometer("D0", one.gyro_c),
            self._warming(self._slope("D0") * (np.mean(self.gyro_c[self._own]) - one.gyro_c)),
            *self._steps("gyro", self._own, gain / kg),
        ]
        yield self._finding("D0", zero_dps, lines)
        rates = self.visit.turned(self.axis)
        yield self._finding(
            "KG", kg, [
                scatter_line(self.noise.gyro_turning, turning),
                *self._of("gyro").clock_of_scale(kg),
                *self._of("gyro").hidden([each.acquisition for each in rates], rate_weights(rates)),
                *(line.times(kg) for line in harmonics_of_rates(rates, self.bench)),
                BudgetLine(PARTIAL_TURNS, "B", kg * self._leakage(rates), None, PARTIAL_TURNS),
                self._thermometer("KG", one.gyro_c),
                self._warming(self._slope("KG") * (self._turned_c(rates) - one.gyro_c)),
            ],
        )  # fmt: skip

    def _leakage(self, rates: list[Turning]) -> float:
        """Relative effect of earth rate across a misaligned gyro; zero over whole turns (equations 4.3)."""
        leaking_dps = float(local_earth_rate_dps(self.bench.latitude_deg)[1]) * self._gyro_misalignment_rad()
        total = 0.0
        for weight, each in zip(rate_weights(rates), rates, strict=True):
            turned = each.acquisition.turned
            half = math.radians(turned.to_deg - turned.from_deg) / 2 if turned is not None else math.pi
            total += (weight * leaking_dps * math.sin(half) / half) ** 2
        return math.sqrt(total)

    def _gyro_misalignment_rad(self) -> float:
        """Largest misalignment found from the rates about other axes; 1 mrad without one."""
        found = [abs(value) for other in self._others if (value := self._cross(other)[0]) is not None]
        return max(found, default=1e-3)

    # All 24 attitudes

    def _over_attitudes(self) -> Iterator[Finding]:
        accelerometer, gyro = self.fits.accelerometers[self.axis], self.fits.gyros[self.axis]
        if accelerometer is not None:
            used, weights = np.flatnonzero(self.used).tolist(), accelerometer.weights
            lines_k2, *lines = self._of_accelerometer(used, accelerometer.k1_per_g, weights[2:])
            alias = BudgetLine("asymmetry of the converter: contained, inseparable", "alias", 0)
            yield self._finding("K2", accelerometer.k2_g_per_g2, [*lines_k2, alias])
            for other in self._others:
                value = float(accelerometer.misalignment_rad[other])
                yield self._finding("misalignment", value, lines[other], toward=other)
        if gyro is not None:
            kg = self.calibration.kg_pulse_per_deg
            for other in range(len(AXES)):
                value = float(gyro.g_sensitivity_per_g[other]) / kg
                if math.isfinite(value):
                    line = scatter_line(self.noise.gyro_at_rest, gyro.weights[1 + other] / kg)
                    yield self._finding("g_sensitivity", value, [line], toward=other)

    # Rates about other axes

    def _turned_about_others(self) -> Iterator[Finding]:
        for other in self._others:
            value, gain, hidden = self._cross(other)
            if value is None or gain is None:
                continue
            rates = self.visit.turned(other)
            errors = table_errors([rates[0].acquisition], self.unit, self.bench)
            errors = errors.without(Kind.LEVEL)  # the axis of the table tilts with it
            lines = errors.lines(errors.seen(UP, self.axis), np.ones(1))
            yield self._finding(
                "gyro_misalignment", value, [scatter_line(self.noise.gyro_across, gain), *lines, *hidden],
                toward=other,
            )  # fmt: skip

    def _cross(self, other: int) -> tuple[float | None, Array | None, list[BudgetLine]]:
        """Slope of this gyro over rates about another axis, relative to its scale; effect of noise and quantisation."""
        read = about_another(self.axis, other, self.unit, self.visit)
        try:
            fit = least_squares(np.stack([np.ones_like(read.rate_dps), read.rate_dps], axis=-1), read.output)
        except NotDetermined:
            return None, None, []
        gain = fit.gain[1] / self.calibration.kg_pulse_per_deg
        hidden = quantisation_by_level(
            gain, read.quantisation_u, np.zeros_like(gain)
        )  # its readings across the rates hardly change
        value = float(fit.coefficients[1] / self.calibration.kg_pulse_per_deg)
        return value, gain / np.sqrt(read.span_s), list(self._of("gyro").stepped(hidden))

    # Parts of findings

    def _of_accelerometer(
        self, attitudes: Sequence[int], k1_per_g: float, weights: Iterable[Array]
    ) -> list[list[BudgetLine]]:
        """Lines of results with these sensitivities, each (n,), to the accelerometer's readings in attitudes (n,)."""
        errors, moved = self.errors.of(attitudes), self._moved(attitudes)
        seen = [k1_per_g * each for each in errors.seen(UP, self.axis)]
        return [
            [
                scatter_line(self.noise.accelerometer, gain),
                *errors.lines(seen, gain),
                self._warming(float(gain @ moved)),
                *self._steps("acc", attitudes, gain),
            ]
            for gain in weights
        ]

    def _steps(self, sensor: str, attitudes: Iterable[int], gain: Array) -> Iterator[BudgetLine]:
        """Quantisation uncertainty of a result with sensitivities `gain` (n,) to the readings in attitudes.

        Readings with the axis up fall into one step, and so do those with it down, and level.
        """
        numbers = list(attitudes)
        windows = [self.visit.window_of(number) for number in numbers]
        return self._of(sensor).hidden(windows, gain, SPECIFIC_FORCE_G[numbers, self.axis])

    def _of(self, sensor: str) -> OwnErrors:
        return OwnErrors(self.unit, self.bench, f"{sensor}_{AXES[self.axis]}")

    def _windows(self, attitudes: Iterable[int]) -> list[Acquisition]:
        return [window for index in attitudes if (window := self.visit.window_of(index)) is not None]

    @property
    def _own(self) -> range:
        own = block(self.axis)
        return range(own.start, own.stop)

    @property
    def _others(self) -> list[int]:
        return [other for other in range(len(AXES)) if other != self.axis]

    def _thermometer(self, quantity: str, temperature_c: float) -> BudgetLine:
        name = self._reading_of("acc" if quantity in ("K0", "K1") else "gyro")
        slope = self.slopes.get(quantity, math.nan)
        per_c = self.per_c_u[quantity] if math.isnan(slope) else abs(slope)
        return self.bench.temperature(name, temperature_c).times(per_c)

    def _slope(self, quantity: str) -> float:
        """Slope over temperature; 0 if unknown."""
        slope = self.slopes.get(quantity, math.nan)
        return 0.0 if math.isnan(slope) else slope

    def _moved(self, attitudes: Sequence[int]) -> Array:
        """Changes of the accelerometer's readings in attitudes, because its temperature differed from the mean."""
        away_c = self.accelerometer_c[attitudes] - self.calibration.accelerometer_c
        force_g, k1 = SPECIFIC_FORCE_G[attitudes, self.axis], self.calibration.k1_per_g
        bias_g = self.calibration.k0 / k1
        moved = away_c * (k1 * self._slope("K0") + (force_g + bias_g) * self._slope("K1"))
        return np.where(np.isfinite(moved), moved, 0.0)

    def _turned_c(self, rates: list[Turning]) -> float:
        """Temperature of the gyro during the rates."""
        name = self._reading_of("gyro")
        return float(np.mean([each.acquisition.temperatures_c[name].mean() for each in rates]))

    def _reading_of(self, sensor: str) -> str:
        """Reading of the thermometer of the accelerometer or the gyro of the axis."""
        return self.unit.thermometer(f"{sensor}_{AXES[self.axis]}")

    def _warming(self, moved: float | np.floating) -> BudgetLine:
        """Line for the temperature change during a visit, which is not corrected."""
        return BudgetLine("temperature: changes during the visit", "B", abs(float(moved)))

    def _finding(self, quantity: str, value: float, lines: list[BudgetLine], toward: int | None = None) -> Finding:
        of_gyro = quantity in ("D0", "KG", "g_sensitivity", "gyro_misalignment")
        name = self._reading_of("gyro" if of_gyro else "acc")
        temperature_c = self.calibration.gyro_c if of_gyro else self.calibration.accelerometer_c
        at = {
            "visit": self.visit.number,
            "axis": AXES[self.axis],
            **({"toward": AXES[toward]} if toward is not None else {}),
            "temperature_set_c": self.visit.told_set_c,
            "temperature_c": temperature_c,
            "temperature_u_c": self.bench.temperature_u_c(name, temperature_c),
        }
        axes = f"{AXES[self.axis]}{'' if toward is None else AXES[toward]}"
        return self.subject.part(axes).finding(
            quantity, NAMES[quantity], value, self._unit_of(quantity), lines, at, self._steps_of(of_gyro, toward),
            self.visit.tail,
            CONTAINS.get(quantity, ()),
        )  # fmt: skip

    def _unit_of(self, quantity: str) -> str:
        match quantity:
            case "K1":
                return f"{self.unit.output_unit}/g"
            case "K1_si":
                return f"{self.unit.output_unit}/(m/s²)"
            case "KG":
                return gyro_scale_unit(self.unit)
        return UNITS[quantity]

    def _steps_of(self, of_gyro: bool, toward: int | None) -> tuple[str, ...]:
        if toward is not None and of_gyro:
            return tuple(each.acquisition.step for each in self.visit.turned(toward))
        return tuple(window.step for window in self._windows(self._own))
