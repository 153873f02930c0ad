"""Method M4a: bias, scale factor, K2 and misalignment at each dwell, and their models over temperature.

Type A is the scatter of the readings about their tumbles, pooled over the run; type B comes from the certificates of
the bench by the derivatives of the solution. The temperature is that of the unit's thermometer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from bench.methods.tumble.reduction.constants import TumbleConstants
from bench.methods.tumble.reduction.dwells import solve_dwells
from bench.methods.tumble.reduction.over_temperature import TumbleOverTemperature
from bench.methods.tumble.reduction.temperature_models import TemperatureModels, temperature_models
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.least_squares import PolynomialFit
from bench.metrology.results.curves import TemperatureModel
from bench.metrology.results.finding import NOT_CLOSED, UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest

MODELLED = ("K0", "K1")


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the findings and models of every unit.

    `settings` has the degree of the temperature models, the reference temperature of their coefficients, and the
    maximum change of the bias when the profile has returned to its first temperature: beyond it every verdict is
    marginal.
    """
    return [_Unit(data, unit, settings).result() for unit in data.units]


@dataclass(frozen=True, slots=True)
class TumbleAngles:
    """Number of angles of a tumble, and the further terms that they separate, for a report."""

    angles: int
    extra: tuple[str, ...]


class _Unit:
    """Reduction of one unit."""

    def __init__(self, data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> None:
        self._settings = settings
        solved = solve_dwells(data, unit)
        self._of = TumbleUnit.of(data, unit, solved.dwells)
        self._left_out, self._extra, self._angles = solved.left_out, solved.extra, solved.angles
        self._flags = list(solved.flags)
        self._flags += ["type_a:no_repeats"] if solved.dwells and not self._of.dof else []
        self._found = {quantity: self._over_temperature(quantity) for quantity in MODELLED}

    def result(self) -> UnitResult:
        per_c_u = {"K0": self._settings["bias_per_c_u"], "K1": self._settings["scale_per_c_u"]}
        per_c = {quantity: self._of.per_c(quantity, found.model) for quantity, found in self._found.items()}
        constants = TumbleConstants(self._of, per_c, self._extra, per_c_u)
        over = TumbleOverTemperature(self._of, self._found, per_c, self._settings["reference_c"])
        findings = [finding for index in range(len(self._of.dwells)) for finding in constants.findings(index)]
        findings += [finding for quantity in MODELLED for finding in over.findings(quantity)]
        findings += over.tilt()
        if (closure := over.closure()) is not None:
            findings.append(closure)
            if abs(closure.value) > self._settings["closure_limit_g"]:
                self._flags.append(NOT_CLOSED)
                findings = [finding.flagged(NOT_CLOSED) for finding in findings]
        models = [self._model(quantity, fit) for quantity in MODELLED for fit in self._fits(quantity)]
        return UnitResult(
            place=self._of.unit.place,
            uut=self._of.unit.serial,
            findings=tuple(findings),
            models=tuple(models),
            left_out=self._left_out,
            flags=tuple(dict.fromkeys(self._flags)),
            compensations=tuple(self._compensations()),
            detail=TumbleAngles(self._angles, self._extra) if self._of.dwells else None,
        )

    def _compensations(self) -> Iterator[Compensation]:
        """Conversion of an output to an acceleration, by the models of the highest degree."""
        bias, scale = (self._found[quantity].model for quantity in MODELLED)
        if bias is not None and scale is not None:
            unit, scale_model = self._of.unit, self._model("K1", scale)
            yield Compensation(unit.measured_by, unit.output_unit, "g", scale=scale_model, bias=self._model("K0", bias))

    def _over_temperature(self, quantity: str) -> TemperatureModels:
        found = temperature_models(quantity, self._of.values(quantity), self._of.dwells, self._settings["degree"])
        self._flags += found.flags
        if found.line is None:
            self._flags.append(f"{quantity}:temperature_slope_unknown")
        return found

    def _fits(self, quantity: str) -> Iterator[PolynomialFit]:
        """The model, and the straight line unless the model is one."""
        model, line = self._found[quantity].model, self._found[quantity].line
        if model is not None:
            yield model
        if line is not None and (model is None or model.degree > 1):
            yield line

    def _model(self, quantity: str, fit: PolynomialFit) -> TemperatureModel:
        return TemperatureModel.of_fit(
            fit,
            id=self._of.subject.id(f"{quantity}/model={fit.degree}"),
            uut=self._of.unit.serial,
            quantity=quantity,
            unit=self._of.units[quantity],
            used=len(self._of.dwells),
            left_out=self._left_out,
        )
