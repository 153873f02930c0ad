"""Results of the dwells of a unit over temperature: slopes, hysteresis, residuals, tilt, and stability check."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from bench.methods.tumble.reduction.dwells import Dwell
from bench.methods.tumble.reduction.solution import Hysteresis
from bench.methods.tumble.reduction.temperature_models import TemperatureModels
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.extremes import interval_of_largest
from bench.metrology.least_squares import Array, PolynomialFit, fit_polynomial
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Interval, Subject
from bench.metrology.tilt_findings import TiltOrigin, tilt_findings

TERMS = ("linear", "quadratic")
CONTAINED = "residuals of the model: contained"
HIGHEST = 2  # power of T - Tref that has a coefficient
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class TumbleOverTemperature:
    """`models` has those of each quantity over temperature.

    `per_c` is the effect of a thermometer error of 1 °C at the dwells (n,), None without a model. Coefficients refer to
    `reference_c`.
    """

    of: TumbleUnit
    models: Mapping[str, TemperatureModels]
    per_c: Mapping[str, Array | None]
    reference_c: float

    def findings(self, quantity: str) -> Iterator[Finding]:
        """Slope, hysteresis and residual of the model; of the scale factor relative to its value at the centre."""
        found, per_c = self.models[quantity], self.per_c[quantity]
        model, line, loop = found.model, found.line, found.loop
        if model is None or line is None or per_c is None:
            return
        relative = 1.0 if quantity == "K0" else 1 / float(line.value(line.centre))
        yield self._coefficient(quantity, line, per_c, relative)
        yield from self._about_reference(quantity, model, per_c)
        if loop is not None:
            yield from self._loop(quantity, loop, self.of.drifted(per_c), relative)
        worst = int(np.argmax(np.abs(model.residuals)))
        name = f"largest residual of the model of degree {model.degree}"
        left = fit_polynomial(self.of.temperatures_c, self.of.drifted(per_c), model.degree).residuals
        interval = interval_of_largest(model.residuals, np.hypot(self.of.own_u(quantity), left)).times(relative)
        yield self._of_dwells(
            f"{quantity}/model_residual", name, model.max_residual, abs(relative), (self.of.dwells[worst],),
            float(left[worst]), interval,
        )  # fmt: skip

    def _loop(self, quantity: str, loop: Hysteresis, drifted: Array, relative: float) -> Iterator[Finding]:
        """Largest difference between rising and falling temperature, then that of each two dwells with its sign.

        `drifted` (n,) is the effect of the drift of the thermometer on the quantity at the dwells.
        """
        own, apart = self.of.own_u(quantity)[loop.pairs], drifted[loop.pairs[:, 0]] - drifted[loop.pairs[:, 1]]
        interval = interval_of_largest(loop.differences, np.hypot(np.hypot(*own.T), apart)).times(relative)
        yield self._of_dwells(
            f"{quantity}/hysteresis", "largest difference between rising and falling temperature", loop.value,
            abs(relative), (self.of.dwells[loop.rising], self.of.dwells[loop.falling]),
            float(drifted[loop.rising] - drifted[loop.falling]), interval,
        )  # fmt: skip
        pairs = [(self.of.dwells[up], self.of.dwells[down]) for up, down in loop.pairs.tolist()]
        in_order = sorted(range(len(pairs)), key=lambda index: (pairs[index][0].cycle, pairs[index][0].set_c))
        for number, index in enumerate(in_order):
            up, down = pairs[index]
            found = self._of_dwells(
                f"{quantity}/loop", "rising less falling temperature", float(loop.differences[index]), relative,
                (up, down), float(apart[index]),
            )  # fmt: skip
            yield replace(found, id=f"{found.id}/{number}", at={"point": number, "cycle": up.cycle, **found.at})

    def tilt(self) -> Iterator[Finding]:
        """Tilt error of the unit due to its bias, with a constant and with the model of K0."""
        model = self.models["K0"].model
        if model is None:
            return iter(())
        bias_g = self.of.values("K0")
        sd_g = float(np.mean(self.of.own_u("K0")))
        origin = TiltOrigin(self.of.subject, (self.of.root,), sd_g, self.of.dof or None)
        return tilt_findings(bias_g, bias_g - model.residuals, origin)

    def closure(self) -> Finding | None:
        """Bias of the last dwell minus that of the first, if the profile returns to its first temperature.

        A slight difference of temperature is corrected by the model. Only errors independent between readings, and the
        drift of the thermometer in between, do not cancel.
        """
        if not self.of.dwells:
            return None
        first, last, model = self.of.dwells[0], self.of.dwells[-1], self.models["K0"].model
        if first is last or first.set_c != last.set_c:
            return None
        middle_c, apart_c = (first.temperature_c + last.temperature_c) / 2, last.temperature_c - first.temperature_c
        expected = float(model.slope(middle_c)) * apart_c if model is not None else 0.0
        name = "closure: last dwell less first, both at the first temperature"
        change, drifted = last.values["K0"] - first.values["K0"] - expected, self.of.drifted(self.per_c["K0"])
        return self._of_dwells("K0/closure", name, change, 1.0, (first, last), float(drifted[-1] - drifted[0]))

    def _coefficient(self, quantity: str, line: PolynomialFit, per_c: Array, relative: float) -> Finding:
        """Slope of the straight line, for the unit as it was at the dwells (docs/decisions/0057)."""
        gain = line.fit.gain[1] / line.scale * relative
        lines = [
            *self.of.own_over_dwells(quantity, gain),
            *self.of.by_thermometer(gain, per_c),
            BudgetLine(CONTAINED, "alias", 0),
        ]
        slope = float(line.coefficients[1]) / line.scale * relative
        name = f"{'slope' if quantity == 'K0' else 'relative slope'} of the straight line over temperature"
        unit, at = "g/°C" if quantity == "K0" else "1/°C", {"temperature_c": line.centre}
        return self.of.subject.finding(
            f"{quantity}/temperature_coefficient", name, slope, unit, lines, at, (self.of.root,)
        )

    def _about_reference(self, quantity: str, model: PolynomialFit, per_c: Array) -> Iterator[Finding]:
        """First coefficients of the model's series about the reference temperature."""
        return coefficient_findings(
            self.of.subject, quantity, model, self.reference_c, (self.of.root,),
            lambda weights: [*self.of.own_over_dwells(quantity, weights), *self.of.by_thermometer(weights, per_c)],
        )  # fmt: skip

    def _of_dwells(
        self,
        quantity: str,
        name: str,
        value: float,
        relative: float,
        dwells: tuple[Dwell, ...],
        by_drift: float,
        interval: Interval | None = None,
    ) -> Finding:
        """Finding from one or two dwells; only errors independent between readings do not cancel.

        `by_drift` is the contribution of the drift of the thermometer, before it is made `relative`.
        """
        lines = self.of.own(quantity.partition("/")[0], [(dwell, relative) for dwell in dwells])
        lines.append(self.of.drift.line(by_drift * relative))
        at = {
            "temperature_set_c": None if math.isnan(dwells[0].set_c) else dwells[0].set_c,
            "temperature_c": float(np.mean([dwell.temperature_c for dwell in dwells])),
            "dwells": [dwell.path for dwell in dwells],
        }
        unit, steps = "g" if quantity.startswith("K0") else "1", tuple(dwell.group for dwell in dwells)
        return self.of.subject.finding(quantity, name, value * relative, unit, lines, at, steps, interval=interval)


def coefficient_findings(
    subject: Subject, quantity: str, model: PolynomialFit, reference_c: float, steps: tuple[str, ...],
    budget: Callable[[Array], Sequence[BudgetLine]],
) -> Iterator[Finding]:  # fmt: skip
    """T1 and T2 of K0 in g, or of K1 relative to it, about a reference temperature; a straight line has no T2.

    They describe the unit at these dwells, so that residuals of the model, such as hysteresis, are contained in the
    values and contribute no uncertainty: a second run of the same profile would give the same. Errors that are common
    to all dwells, of the head and of the time base, cancel. `budget` returns the lines of a result with sensitivities
    (n,) to the fitted values.
    """
    of_bias = quantity == "K0"
    found = (bias_coefficients if of_bias else scale_coefficients)(model, reference_c)
    for index, value in enumerate((found.t1, found.t2)[: model.degree]):
        lines = [*budget(found.gain[index]), BudgetLine(CONTAINED, "alias", 0)]
        name = f"{TERMS[index]} temperature coefficient of the {'bias' if of_bias else 'scale factor'}"
        unit = ("g/°C" if of_bias else "1/°C") + "²" * index
        yield subject.finding(
            f"{quantity}T{index + 1}", name, value, unit, lines, {"at_c": reference_c}, steps,
            flags=("extrapolated",) if found.extrapolated else (),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class TemperatureCoefficients:
    """T1 and T2 of a quantity: per °C and per °C², in the unit of the quantity or relative to it.

    `gain` (2, n) is the sensitivity of T1 and T2 to each fitted value. T2 of a straight line is NaN. `extrapolated` is
    true if the reference temperature is outside the fitted range.
    """

    t1: float
    t2: float
    gain: Array
    extrapolated: bool


def bias_coefficients(bias: PolynomialFit, reference_c: float) -> TemperatureCoefficients:
    """K0T1 and K0T2, in the unit of the bias per °C and per °C². `bias` is at least a straight line."""
    series = _series(bias, reference_c)
    _, t1, t2 = series @ bias.coefficients
    return _coefficients(bias, reference_c, (t1, t2), series[1:])


def scale_coefficients(scale: PolynomialFit, reference_c: float) -> TemperatureCoefficients:
    """K1T1 and K1T2, relative to K1 at the reference temperature. `scale` is at least a straight line, and not 0."""
    series = _series(scale, reference_c)
    k1, *slopes = series @ scale.coefficients
    t1, t2 = np.array(slopes) / k1
    jacobian = (series[1:] - np.outer((t1, t2), series[0])) / k1
    return _coefficients(scale, reference_c, (t1, t2), jacobian)


def _series(model: PolynomialFit, reference_c: float) -> Array:
    """Matrix (3, p) from the coefficients (p,) of a model to those of the powers 0 to 2 of T - reference."""
    z = (reference_c - model.centre) / model.scale
    series = np.zeros((HIGHEST + 1, model.degree + 1))
    for power in range(min(HIGHEST, model.degree) + 1):
        shifted = [comb(k, power) * z ** max(k - power, 0) for k in range(model.degree + 1)]  # of (z + d)^k, at d^power
        series[power] = np.array(shifted) / model.scale**power
    return series


def _coefficients(model: PolynomialFit, reference_c: float, values: Pair, jacobian: Array) -> TemperatureCoefficients:
    """T1 and T2 (2,), with their derivatives with respect to the coefficients of the model, (2, p)."""
    low_c, high_c = model.valid
    known = np.array([1.0, 1.0 if model.degree >= HIGHEST else np.nan])
    return TemperatureCoefficients(
        t1=float(values[0]),
        t2=float(values[1] * known[1]),
        gain=jacobian * known[:, np.newaxis] @ model.fit.gain,
        extrapolated=not low_c <= reference_c <= high_c,
    )
