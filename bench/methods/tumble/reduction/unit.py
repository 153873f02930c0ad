"""Dwells of one unit, with the scatter of its readings and the uncertainty of its thermometer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.methods.tumble.reduction.dwells import Dwell
from bench.metrology.acquisition import Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import PolynomialFit
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Subject
from bench.metrology.reversible import reversible_slope
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.thermometer_drift import DriftInRun

UNITS = {
    "K0": "g", "misalignment": "rad", "misalignment_y": "rad", "K2": "g/g²", "K3": "g/g³", "Kip": "g/g²", "Kio": "g/g²",
    "asymmetry": "1",
}  # fmt: skip
READINGS = "readings: scatter pooled over the run"


@dataclass(frozen=True, slots=True)
class TumbleUnit:
    """One unit over a run.

    `sd` is the standard deviation of a reading about its tumble, pooled over all dwells, with `dof` degrees of freedom;
    if no reading repeats another, dof is 0 and `sd` the single-reading uncertainty.
    """

    data: RunData
    unit: UnitUnderTest
    dwells: tuple[Dwell, ...]
    sd: float
    dof: int

    @classmethod
    def of(cls, data: RunData, unit: UnitUnderTest, dwells: tuple[Dwell, ...]) -> Self:
        """The unit with the scatter of its readings pooled, over dwells without a loss of power if there are any.

        The step of a power cycle is no scatter.
        """
        steady = [dwell for dwell in dwells if not dwell.interrupted] or dwells
        dof = sum(dwell.tumble.fit.dof for dwell in steady)
        if dof == 0:
            return cls(data, unit, dwells, max((dwell.single_u for dwell in dwells), default=0.0), 0)
        squares = sum(float(np.sum(dwell.tumble.fit.residuals**2)) for dwell in steady)
        return cls(data, unit, dwells, float(np.sqrt(squares / dof)), dof)

    @property
    def subject(self) -> Subject:
        """Unit and label of the findings."""
        return self.data.subject(self.unit)

    @property
    def bench(self) -> BenchRecord:
        """Uncertainties of the bench."""
        return self.data.bench

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the coefficients of a dwell."""
        output = self.unit.output_unit
        return {**UNITS, "K1": f"{output}/g", "K1_si": f"{output}/(m/s²)"}

    @property
    def root(self) -> str:
        """Part of the run that contains all dwells."""
        return self.dwells[0].group.rpartition("/")[0]

    def temperature_u_c(self, temperature_c: float) -> float:
        """Standard uncertainty of a temperature by it."""
        return self.bench.temperature_u_c(self.unit.temperature, temperature_c)

    @property
    def drift(self) -> DriftInRun:
        """Drift of the thermometer at the unit."""
        return DriftInRun(self.data, self.unit.temperature)

    @property
    def temperatures_c(self) -> Array:
        """Temperatures of the dwells (n,)."""
        return np.array([dwell.temperature_c for dwell in self.dwells])

    def values(self, quantity: str) -> Array:
        """A coefficient at each dwell, (n,)."""
        return np.array([dwell.values[quantity] for dwell in self.dwells])

    def per_c(self, quantity: str, model: PolynomialFit | None) -> Array | None:
        """Effect of a thermometer error of 1 °C on a coefficient at each dwell, (n,); None without a model."""
        if model is None:
            return None
        scatter = float(np.sqrt(np.mean(self.own_u(quantity) ** 2)))
        return reversible_slope(self.temperatures_c, self.values(quantity), scatter, model)

    def drifted(self, per_c: Array | None) -> Array:
        """Effect of one standard uncertainty of the thermometer's drift on a coefficient at each dwell: (n,).

        Zero without a model, which takes no temperature into account.
        """
        if per_c is None:
            return np.zeros(len(self.dwells))
        return np.asarray(per_c * self.drift.error_c(np.array([dwell.middle_s for dwell in self.dwells])))

    def by_thermometer(self, gain: Array, per_c: Array) -> list[BudgetLine]:
        """Contribution of the thermometer to a result with sensitivities `gain` (n,) to a coefficient at the dwells.

        One error shifts the temperatures of all dwells together, and the coefficient by `per_c` (n,).
        """
        thermometer = self.unit.temperature
        offset_u_c, gain_u = self.bench.thermometer_u(thermometer)
        each = gain * per_c
        return [
            BudgetLine(f"{thermometer}: gain", "B", float(each @ self.temperatures_c) * gain_u, None, thermometer),
            BudgetLine(f"{thermometer}: offset", "B", float(each.sum()) * offset_u_c, None, thermometer),
            self.drift.line(float(gain @ self.drifted(per_c))),
        ]

    def scatter(self, gain: Array) -> BudgetLine:
        """Contribution of the scatter of the readings to a result with sensitivities `gain` (n,)."""
        u = self.sd * float(np.linalg.norm(gain))
        if self.dof:
            return BudgetLine(READINGS, "A", u, self.dof)
        if self.unit.telemetry is not None:
            return BudgetLine("readings: scatter of the samples, no repeats", "A", u)
        if self.unit.voltmeter is not None:
            return BudgetLine("readings: scatter of the voltmeter, no repeats", "A", u)
        return BudgetLine("readings: resolution of the count, no repeats", "B", u)

    def own(self, quantity: str, weights: Iterable[tuple[Dwell, float]]) -> list[BudgetLine]:
        """Budget lines of errors independent between readings, for a weighted sum of a quantity at dwells.

        These are the scatter of the readings and the repeatability of the head. Residuals of tumbles contain the second
        in part: a vertical axis is insensitive to it, a level one has its full effect.
        """
        gains = [(dwell, dwell.gain_of(quantity) * weight) for dwell, weight in weights]
        turned = np.concatenate([gain * dwell.turn for dwell, gain in gains])
        u_rad = np.radians(self.bench.head.repeatability_u_deg)
        return [
            self.scatter(np.concatenate([gain for _, gain in gains])),
            BudgetLine("head: repeatability", "B", float(np.linalg.norm(turned) * u_rad)),
        ]

    def own_over_dwells(self, quantity: str, weights: Array) -> list[BudgetLine]:
        """The same by `weights` (n,) of all dwells."""
        return self.own(quantity, zip(self.dwells, weights.tolist(), strict=True))

    def own_u(self, quantity: str) -> Array:
        """Standard uncertainty from these errors of a coefficient at each dwell, (n,), in its unit."""
        return np.array(
            [np.linalg.norm([line.u for line in self.own(quantity, [(each, 1.0)])]) for each in self.dwells]
        )
