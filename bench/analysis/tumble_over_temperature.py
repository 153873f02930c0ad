"""What the dwells of a unit tell over temperature: slopes, hysteresis, residuals, tilt, and whether the run closes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bench.analysis.coefficient_findings import Origin, coefficient_findings
from bench.analysis.dwells import Dwell
from bench.analysis.extremes import interval_of_largest
from bench.analysis.finding import BudgetLine, Finding, Interval
from bench.analysis.fit import PolynomialFit
from bench.analysis.tilt_findings import TiltOrigin, tilt_findings
from bench.analysis.tumble import hysteresis
from bench.analysis.tumble_unit import TumbleUnit, type_b


@dataclass(frozen=True, slots=True)
class TumbleOverTemperature:
    """`models` are those of the highest degree, `lines` the straight ones; None where the temperatures allow none.

    Coefficients are told about `reference_c`.
    """

    of: TumbleUnit
    models: Mapping[str, PolynomialFit | None]
    lines: Mapping[str, PolynomialFit | None]
    reference_c: float

    def findings(self, quantity: str) -> Iterator[Finding]:
        """Slope, hysteresis and residual of the model; of the scale factor relative to its value at the centre."""
        model, line = self.models[quantity], self.lines[quantity]
        if model is None or line is None:
            return
        relative = 1.0 if quantity == "K0" else 1 / float(line.value(line.centre))
        yield self._coefficient(quantity, line, relative)
        yield from self._about_reference(quantity, model)
        loop = hysteresis(
            np.array([dwell.values[quantity] for dwell in self.of.dwells]),
            np.array([dwell.temperature_c for dwell in self.of.dwells]),
            np.array([dwell.set_c for dwell in self.of.dwells]),
            rising=np.array([dwell.rising for dwell in self.of.dwells]),
            cycle=np.array([dwell.cycle for dwell in self.of.dwells]),
            slope=model.slope,
        )
        if loop is not None:
            dwells = (self.of.dwells[loop.rising], self.of.dwells[loop.falling])
            name = "largest difference between rising and falling temperature"
            own = self.of.scatter_of(quantity)[loop.pairs]
            interval = interval_of_largest(loop.differences, np.hypot(*own.T)).times(relative)
            yield self._largest(f"{quantity}/hysteresis", name, loop.value, relative, dwells, interval)
        worst = self.of.dwells[int(np.argmax(np.abs(model.residuals)))]
        name = f"largest residual of the model of degree {model.degree}"
        interval = interval_of_largest(model.residuals, self.of.scatter_of(quantity)).times(relative)
        yield self._largest(f"{quantity}/model_residual", name, model.max_residual, relative, (worst,), interval)

    def tilt(self) -> Iterator[Finding]:
        """What the bias makes of the unit as a tilt meter, with a constant and with the model of K0."""
        model = self.models["K0"]
        if model is None:
            return iter(())
        bias_g = np.array([dwell.values["K0"] for dwell in self.of.dwells])
        sd_g = self.of.sd * float(np.mean([np.linalg.norm(dwell.gain_of("K0")) for dwell in self.of.dwells]))
        origin = TiltOrigin(self.of.subject, (self.of.root,), sd_g, self.of.dof or None)
        return tilt_findings(bias_g, bias_g - model.residuals, origin)

    def closure(self) -> Finding | None:
        """The bias of the last dwell less that of the first, where the profile returns to its first temperature.

        The two stood at slightly different temperatures, which the model brings together. Of all sources only the
        readings are not common to both.
        """
        if not self.of.dwells:
            return None
        first, last, model = self.of.dwells[0], self.of.dwells[-1], self.models["K0"]
        if first is last or first.set_c != last.set_c:
            return None
        middle_c, apart_c = (first.temperature_c + last.temperature_c) / 2, last.temperature_c - first.temperature_c
        expected = float(model.slope(middle_c)) * apart_c if model is not None else 0.0
        name = "closure: last dwell less first, both at the first temperature"
        return self._largest("K0/closure", name, last.values["K0"] - first.values["K0"] - expected, 1.0, (first, last))

    def _coefficient(self, quantity: str, line: PolynomialFit, relative: float) -> Finding:
        """The slope of the straight line."""
        slope = float(line.coefficients[1]) / line.scale * relative
        thermometer, (_, gain) = self.of.unit.temperature, self.of.thermometer_u
        lines = [
            self._slope(quantity, line, relative),
            type_b(f"{thermometer}: gain", abs(slope) * gain, thermometer),
        ]
        name = f"{'slope' if quantity == 'K0' else 'relative slope'} of the straight line over temperature"
        unit, at = "g/°C" if quantity == "K0" else "1/°C", {"temperature_c": line.centre}
        return self.of.subject.finding(
            f"{quantity}/temperature_coefficient", name, slope, unit, lines, at, (self.of.root,)
        )

    def _about_reference(self, quantity: str, model: PolynomialFit) -> Iterator[Finding]:
        """The first coefficients of the model's series about the reference temperature."""
        origin = Origin(
            subject=self.of.subject,
            steps=(self.of.root,),
            thermometer=self.of.unit.temperature,
            thermometer_u=self.of.thermometer_u,
            scatter=lambda weights: self.of.scatter(self.of.by_readings(quantity, weights)),
        )
        return coefficient_findings(quantity, model, self.reference_c, origin)

    def _slope(self, quantity: str, line: PolynomialFit, relative: float) -> BudgetLine:
        """What the scatter about the line gives to its slope; through two temperatures, what the readings give."""
        if line.dof:
            return BudgetLine("fit", "A", abs(float(line.u[1]) / line.scale * relative), line.dof)
        return self.of.scatter(self.of.by_readings(quantity, line.fit.gain[1] / line.scale * relative))

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
        at = {
            "temperature_set_c": None if math.isnan(dwells[0].set_c) else dwells[0].set_c,
            "temperature_c": float(np.mean([dwell.temperature_c for dwell in dwells])),
            "dwells": [dwell.path for dwell in dwells],
        }
        unit, steps = "g" if quantity.startswith("K0") else "1", tuple(dwell.group for dwell in dwells)
        return self.of.subject.finding(
            quantity, name, value * relative, unit, [self.of.scatter(gain)], at, steps, interval=interval
        )
