"""Method M4a: bias, scale factor, K2 and misalignment at each dwell, and their models over temperature.

Type A is the scatter of the readings about their tumbles, pooled over the run; type B comes from the certificates of
the bench by the derivatives of the solution. The temperature is what the unit's thermometer says.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.analysis.codes import by_position
from bench.analysis.coefficient_findings import Origin, coefficient_findings
from bench.analysis.compensation import Compensation
from bench.analysis.dwells import Dwell, solve_dwells
from bench.analysis.extremes import interval_of_largest
from bench.analysis.finding import NOT_CLOSED, BudgetLine, Finding, Interval, Subject, UnitResult, combined
from bench.analysis.fit import NotDetermined, PolynomialFit, fit_polynomial
from bench.analysis.models import TemperatureModel
from bench.analysis.rundata import Array, RunData, UnitUnderTest
from bench.analysis.tilt_findings import TiltOrigin, tilt_findings
from bench.analysis.tumble import hysteresis

UNITS = {"K0": "g", "misalignment": "rad", "K2": "g/g²", "K3": "g/g³", "Kip": "g/g²", "asymmetry": "1"}
NAMES = {
    "K0": "bias of the channel",
    "K1": "scale factor of the channel, per local g",
    "K1_si": "scale factor of the channel, per m/s²",
    "K2": "K2 + asymmetry: second-order nonlinearity, and the asymmetry of what measures it",
    "misalignment": "misalignment of the input axis in the plane of the tumble",
    "K3": "third-order nonlinearity",
    "Kip": "cross coupling of input and pendulous axis",
    "asymmetry": "asymmetry of the converter: its scale for positive pulses less that for negative, relative",
}
CONTAINS = {"K1": ("K3",), "K1_si": ("K3",), "K2": ("asymmetry",)}  # unless these are found by themselves
MODELLED = ("K0", "K1")
READINGS = "readings: scatter pooled over the run"
WEIGHT_SHOWN = 0.05  # of the largest weight: readings with less are not named as a finding's source


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """The findings and models of every unit.

    `settings` has the degree of the temperature models, the temperature about which their coefficients are told, and
    how far the bias may be from where it began when the profile has come back to its first temperature: beyond that
    every verdict is marginal.
    """
    return [_Unit(data, unit, settings).result() for unit in data.units]


@dataclass(frozen=True, slots=True)
class TumbleAngles:
    """How many angles a tumble had, and which further terms they separate, for a report."""

    angles: int
    extra: tuple[str, ...]


class _Unit:
    """The reduction of one unit."""

    def __init__(self, data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> None:
        degree, self._reference_c = settings["degree"], settings["reference_c"]
        self._closure_limit_g = settings["closure_limit_g"]
        self._label, self._unit, self._bench = data.label, unit, data.bench
        self._units = {**UNITS, "K1": f"{unit.output_unit}/g", "K1_si": f"{unit.output_unit}/(m/s²)"}
        solved = solve_dwells(data, unit)
        self._dwells, self._left_out = solved.dwells, solved.left_out
        self._extra, self._angles = solved.extra, solved.angles
        self._flags = list(solved.flags)
        self._sd, self._dof = self._pooled()
        self._models = {quantity: self._fit(quantity, degree) for quantity in MODELLED}
        self._lines = {quantity: self._fit(quantity, 1) for quantity in MODELLED}

    def result(self) -> UnitResult:
        findings = [finding for dwell in self._dwells for finding in self._at_dwell(dwell)]
        findings += [finding for quantity in MODELLED for finding in self._over_temperature(quantity)]
        findings += self._tilt()
        if (closure := self._closure()) is not None:
            findings.append(closure)
            if abs(closure.value) > self._closure_limit_g:
                self._flags.append(NOT_CLOSED)
                findings = [replace(finding, flags=(*finding.flags, NOT_CLOSED)) for finding in findings]
        models = [self._model(quantity, fit) for quantity in MODELLED for fit in self._fits(quantity)]
        return UnitResult(
            place=self._unit.place,
            uut=self._unit.serial,
            findings=tuple(findings),
            models=tuple(models),
            left_out=self._left_out,
            flags=tuple(dict.fromkeys(self._flags)),
            compensations=tuple(self._compensations()),
            detail=TumbleAngles(self._angles, self._extra) if self._dwells else None,
        )

    def _compensations(self) -> Iterator[Compensation]:
        """How an output becomes an acceleration, by the models of the highest degree."""
        bias, scale = (self._models[quantity] for quantity in MODELLED)
        if bias is not None and scale is not None:
            unit, scale_model = self._unit, self._model("K1", scale)
            yield Compensation(unit.measured_by, unit.output_unit, "g", scale=scale_model, bias=self._model("K0", bias))

    def _id(self, quantity: str, dwell: Dwell | None = None) -> str:
        tail = f"@{dwell.path}" if dwell is not None and dwell.path else ""
        return f"{self._label}/{self._unit.place}/{quantity}{tail}"

    def _pooled(self) -> tuple[float, int]:
        """Standard deviation of one reading about its tumble, over all dwells, and its degrees of freedom.

        Without repeats nothing scatters; then it is what a reading alone tells, and flagged.
        """
        dof = sum(dwell.tumble.fit.dof for dwell in self._dwells)
        if dof == 0:
            self._flags += ["type_a:no_repeats"] if self._dwells else []
            return max((dwell.alone_u for dwell in self._dwells), default=0.0), 0
        squares = sum(float(np.sum(dwell.tumble.fit.residuals**2)) for dwell in self._dwells)
        return float(np.sqrt(squares / dof)), dof

    def _scatter(self, gain: Array) -> BudgetLine:
        """The uncertainty that the readings give to what depends on them by `gain` (n,)."""
        u = self._sd * float(np.linalg.norm(gain))
        if self._dof:
            return BudgetLine(READINGS, "A", u, self._dof)
        if self._unit.telemetry is not None:
            return BudgetLine("readings: scatter of the samples, no repeats", "A", u)
        if self._unit.voltmeter is not None:
            return BudgetLine("readings: scatter of the voltmeter, no repeats", "A", u)
        return BudgetLine("readings: resolution of the count, no repeats", "B", u)

    # Models over temperature

    def _fit(self, quantity: str, degree: int) -> PolynomialFit | None:
        """The model of the highest degree up to `degree` that the temperatures allow."""
        allowed = min(degree, len({dwell.set_c for dwell in self._dwells}) - 1)
        if allowed < degree:
            self._flags.append(f"{quantity}:too_few_temperatures")
        if allowed < 1:
            self._flags.append(f"{quantity}:temperature_slope_unknown")  # its budget lacks the thermometer's part
            return None
        values = np.array([dwell.values[quantity] for dwell in self._dwells])
        try:
            return fit_polynomial(np.array([dwell.temperature_c for dwell in self._dwells]), values, allowed)
        except NotDetermined:
            self._flags.append(f"{quantity}:ill_conditioned")
            return None

    def _fits(self, quantity: str) -> Iterator[PolynomialFit]:
        """The model, and the straight line unless the model is one."""
        model, line = self._models[quantity], self._lines[quantity]
        if model is not None:
            yield model
        if line is not None and (model is None or model.degree > 1):
            yield line

    def _model(self, quantity: str, fit: PolynomialFit) -> TemperatureModel:
        return TemperatureModel.of_fit(
            fit,
            id=self._id(f"{quantity}/model={fit.degree}"),
            uut=self._unit.serial,
            quantity=quantity,
            unit=self._units[quantity],
            used=len(self._dwells),
            left_out=self._left_out,
        )

    # Findings at a dwell

    def _at_dwell(self, dwell: Dwell) -> Iterator[Finding]:
        at = {
            "cycle": dwell.cycle,
            "dwell": dwell.number,
            "leg": "up" if dwell.rising else "down",
            "temperature_set_c": None if math.isnan(dwell.set_c) else dwell.set_c,
            "temperature_c": dwell.temperature_c,
            "temperature_u_c": self._temperature_u_c(dwell.temperature_c),
        }
        for quantity in ("K0", "K1", "K2", "misalignment", *self._extra):
            gain = dwell.gain_of(quantity)
            weights = np.abs(gain) / np.max(np.abs(gain))
            finding = Finding(
                id=self._id(quantity, dwell),
                uut=self._unit.serial,
                quantity=quantity,
                name=self._name(quantity),
                at=at,
                value=dwell.values[quantity],
                unit=self._units[quantity],
                budget=self._budget(quantity, gain, dwell),
                steps=tuple(s for s, weight in zip(dwell.steps, weights, strict=True) if weight > WEIGHT_SHOWN),
                flags=self._contains(quantity),
            )
            yield finding
            if quantity == "K1":
                yield self._per_mps2(finding, dwell)

    def _contains(self, quantity: str) -> tuple[str, ...]:
        """What is in a value because these angles do not separate it."""
        return tuple(f"contains:{name}" for name in CONTAINS.get(quantity, ()) if name not in self._extra)

    def _name(self, quantity: str) -> str:
        if quantity == "K2" and "asymmetry" in self._extra:
            return "second-order nonlinearity"
        return NAMES[quantity]

    def _per_mps2(self, k1: Finding, dwell: Dwell) -> Finding:
        g = self._bench.gravity_mps2
        lines = [
            BudgetLine("K1", "B", k1.u / g, k1.dof, k1.id),
            BudgetLine("site: gravity", "B", k1.value / g * self._bench.gravity_u_mps2 / g, None, "site.gravity"),
        ]
        return Finding(
            id=self._id("K1_si", dwell),
            uut=k1.uut,
            quantity="K1_si",
            name=NAMES["K1_si"],
            at=k1.at,
            value=k1.value / g,
            unit=self._units["K1_si"],
            budget=combined(lines),
            steps=(dwell.group,),
            flags=self._contains("K1_si"),
        )

    def _budget(self, quantity: str, gain: Array, dwell: Dwell) -> tuple[BudgetLine, ...]:
        """Each source by its derivative; the head's errors turn the input axis at every reading."""
        bench, turned = self._bench, gain * dwell.turn
        together = abs(float(turned.sum()))  # all positions turned alike
        harmonics = [
            float(turned @ shape(order * dwell.head_rad)) * np.radians(u_deg)
            for order, u_deg in enumerate(bench.head.harmonics_u_deg, start=1)
            for shape in (np.cos, np.sin)
        ]
        lines = [
            self._scatter(gain),
            _type_b("head: zero", together * np.radians(bench.head.zero_u_deg), "head.zero"),
            _type_b("head: harmonics", np.linalg.norm(harmonics), "head.harmonics"),
            _type_b("head: repeatability", np.linalg.norm(turned) * np.radians(bench.head.repeatability_u_deg), None),
            _type_b("fixture: level", together * np.radians(bench.level_u_deg), "fixture.level"),
            *self._of_the_instrument(gain, dwell),
        ]
        model, thermometer = self._models.get(quantity), self._unit.temperature
        if model is not None:
            u = abs(float(model.slope(dwell.temperature_c))) * self._temperature_u_c(dwell.temperature_c)
            lines.append(_type_b(f"{thermometer}: offset, gain", u, thermometer))
        if quantity == "K2" and "asymmetry" not in self._extra:
            instrument = "converter" if self._unit.voltmeter is None else "voltmeter"
            contained = f"asymmetry of the {instrument}: contained, inseparable at four positions"
            lines.append(BudgetLine(contained, "alias", 0))
        return combined(lines)

    def _of_the_instrument(self, gain: Array, dwell: Dwell) -> list[BudgetLine]:
        """What the certificate of the counter or of the voltmeter gives; an error of the gain is as the output is.

        A unit that sends its output has no instrument but itself, only the steps of its codes.
        """
        scaled, meter = abs(float(gain @ dwell.readings)), self._unit.voltmeter
        if self._unit.telemetry is not None:
            hidden = np.linalg.norm(by_position(gain, dwell.step_u, dwell.head_rad))
            return [_type_b(f"{self._unit.telemetry}: steps of the codes", hidden, None)]
        if meter is None:
            return [_type_b("counter: time base", scaled * self._bench.time_base_u, "counter.time_base")]
        gain_u, offset_u_v = self._bench.voltmeters_u.get(meter, (0.0, 0.0))
        return [
            _type_b(f"{meter}: gain", scaled * gain_u, f"{meter}.gain"),
            _type_b(f"{meter}: offset", abs(float(gain.sum())) * offset_u_v, f"{meter}.offset"),
        ]

    def _temperature_u_c(self, temperature_c: float) -> float:
        offset_c, gain = self._thermometer_u
        return float(np.hypot(offset_c, gain * temperature_c))

    # Findings over temperature

    def _over_temperature(self, quantity: str) -> Iterator[Finding]:
        """Slope, hysteresis and residual of the model; of the scale factor relative to its value at the centre."""
        model, line = self._models[quantity], self._lines[quantity]
        if model is None or line is None:
            return
        relative = 1.0 if quantity == "K0" else 1 / float(line.value(line.centre))
        yield self._coefficient(quantity, line, relative)
        yield from self._about_reference(quantity, model)
        loop = hysteresis(
            np.array([dwell.values[quantity] for dwell in self._dwells]),
            np.array([dwell.temperature_c for dwell in self._dwells]),
            np.array([dwell.set_c for dwell in self._dwells]),
            rising=np.array([dwell.rising for dwell in self._dwells]),
            cycle=np.array([dwell.cycle for dwell in self._dwells]),
            slope=model.slope,
        )
        if loop is not None:
            dwells = (self._dwells[loop.rising], self._dwells[loop.falling])
            name = "largest difference between rising and falling temperature"
            own = self._scatter_of(quantity)[loop.pairs]
            interval = interval_of_largest(loop.differences, np.hypot(*own.T)).times(relative)
            yield self._largest(f"{quantity}/hysteresis", name, loop.value, relative, dwells, interval)
        worst = self._dwells[int(np.argmax(np.abs(model.residuals)))]
        name = f"largest residual of the model of degree {model.degree}"
        interval = interval_of_largest(model.residuals, self._scatter_of(quantity)).times(relative)
        yield self._largest(f"{quantity}/model_residual", name, model.max_residual, relative, (worst,), interval)

    def _scatter_of(self, quantity: str) -> Array:
        """What the readings give to a constant at each dwell, (n,), in its unit."""
        return np.array([self._scatter(dwell.gain_of(quantity)).u for dwell in self._dwells])

    def _coefficient(self, quantity: str, line: PolynomialFit, relative: float) -> Finding:
        """The slope of the straight line."""
        slope = float(line.coefficients[1]) / line.scale * relative
        thermometer, (_, gain) = self._unit.temperature, self._thermometer_u
        lines = [
            self._slope(quantity, line, relative),
            _type_b(f"{thermometer}: gain", abs(slope) * gain, thermometer),
        ]
        return Finding(
            id=self._id(f"{quantity}/temperature_coefficient"),
            uut=self._unit.serial,
            quantity=f"{quantity}/temperature_coefficient",
            name=f"{'slope' if quantity == 'K0' else 'relative slope'} of the straight line over temperature",
            at={"temperature_c": line.centre},
            value=slope,
            unit="g/°C" if quantity == "K0" else "1/°C",
            budget=combined(lines),
            steps=(self._root,),
        )

    def _about_reference(self, quantity: str, model: PolynomialFit) -> Iterator[Finding]:
        """The first coefficients of the model's series about the reference temperature."""
        origin = Origin(
            prefix=self._id(""),
            uut=self._unit.serial,
            steps=(self._root,),
            thermometer=self._unit.temperature,
            thermometer_u=self._thermometer_u,
            scatter=lambda weights: self._scatter(self._by_readings(quantity, weights)),
        )
        return coefficient_findings(quantity, model, self._reference_c, origin)

    @property
    def _thermometer_u(self) -> tuple[float, float]:
        """Standard uncertainties of offset (°C) and gain of the thermometer at the unit."""
        return self._bench.thermometers_u.get(self._unit.temperature, (0.0, 0.0))

    @property
    def _root(self) -> str:
        """The part of the run that holds all dwells."""
        return self._dwells[0].group.rpartition("/")[0]

    def _slope(self, quantity: str, line: PolynomialFit, relative: float) -> BudgetLine:
        """What the scatter about the line gives to its slope; through two temperatures, what the readings give."""
        if line.dof:
            return BudgetLine("fit", "A", abs(float(line.u[1]) / line.scale * relative), line.dof)
        return self._scatter(self._by_readings(quantity, line.fit.gain[1] / line.scale * relative))

    def _by_readings(self, quantity: str, weights: Array) -> Array:
        """How what depends on a quantity at the dwells by `weights` depends on all readings."""
        return np.concatenate([dwell.gain_of(quantity) * w for dwell, w in zip(self._dwells, weights, strict=True)])

    def _tilt(self) -> Iterator[Finding]:
        """What the bias makes of the unit as a tilt meter, with a constant and with the model of K0."""
        model = self._models["K0"]
        if model is None:
            return iter(())
        bias_g = np.array([dwell.values["K0"] for dwell in self._dwells])
        sd_g = self._sd * float(np.mean([np.linalg.norm(dwell.gain_of("K0")) for dwell in self._dwells]))
        subject = Subject(self._label, self._unit.place, self._unit.serial)
        origin = TiltOrigin(subject, (self._root,), sd_g, self._dof or None)
        return tilt_findings(bias_g, bias_g - model.residuals, origin)

    def _closure(self) -> Finding | None:
        """The bias of the last dwell less that of the first, where the profile returns to its first temperature.

        The two stood at slightly different temperatures, which the model brings together. Of all sources only the
        readings are not common to both.
        """
        if not self._dwells:
            return None
        first, last, model = self._dwells[0], self._dwells[-1], self._models["K0"]
        if first is last or first.set_c != last.set_c:
            return None
        middle_c, apart_c = (first.temperature_c + last.temperature_c) / 2, last.temperature_c - first.temperature_c
        expected = float(model.slope(middle_c)) * apart_c if model is not None else 0.0
        name = "closure: last dwell less first, both at the first temperature"
        return self._largest("K0/closure", name, last.values["K0"] - first.values["K0"] - expected, 1.0, (first, last))

    def _largest(
        self,
        quantity: str,
        name: str,
        value: float,
        relative: float,
        dwells: tuple[Dwell, ...],
        interval: Interval | None = None,
    ) -> Finding:
        """A largest value over the dwells; its uncertainty is that of their readings, all else is common to them."""
        gain = np.concatenate([dwell.gain_of(quantity.partition("/")[0]) for dwell in dwells]) * relative
        return Finding(
            id=self._id(quantity),
            uut=self._unit.serial,
            quantity=quantity,
            name=name,
            at={
                "temperature_set_c": None if math.isnan(dwells[0].set_c) else dwells[0].set_c,
                "temperature_c": float(np.mean([dwell.temperature_c for dwell in dwells])),
                "dwells": [dwell.path for dwell in dwells],
            },
            value=value * relative,
            unit="g" if quantity.startswith("K0") else "1",
            budget=combined([self._scatter(gain)]),
            steps=tuple(dwell.group for dwell in dwells),
            interval=interval,
        )


def _type_b(source: str, u: float | np.floating, shared: str | None) -> BudgetLine:
    return BudgetLine(source, "B", float(u), None, shared)
