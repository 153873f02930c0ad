"""Coefficients of a unit at each dwell, with budgets by the derivatives of the solution (equations 6.2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bench.methods.tumble.reduction.dwells import Dwell
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.acquisition import Array
from bench.metrology.instrument import STEPS, instrument_lines
from bench.metrology.orientation import by_harmonics
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.finding import Finding
from bench.metrology.sampled_codes import quantisation_by_angle

NAMES = {
    "K0": "bias of the channel",
    "K1": "scale factor of the channel, per local g",
    "K1_si": "scale factor of the channel, per m/s²",
    "K2": "K2 + asymmetry: second-order nonlinearity, and the asymmetry of what measures it",
    "misalignment": "misalignment of the input axis in the plane of the tumble",
    "misalignment_y": "misalignment of the input axis towards the output axis",
    "K3": "third-order nonlinearity",
    "Kip": "cross coupling of input and pendulous axis",
    "Kio": "cross coupling of input and output axis",
    "asymmetry": "asymmetry of the converter: its scale for positive pulses less that for negative, relative",
}
CONTAINS = {"K1": ("K3",), "K1_si": ("K3",), "K2": ("asymmetry",)}  # unless these are determined separately
WEIGHT_SHOWN = 0.05  # of the largest weight: readings with less are not named as a finding's source


@dataclass(frozen=True, slots=True)
class TumbleConstants:
    """Coefficients of a unit at its dwells.

    `per_c` is the effect of a thermometer error of 1 °C at the dwells (n,), None if unknown. Then `per_c_u` is used,
    the uncertainty of the change of K0 (g) and K1 (relative) with 1 °C. `extra` are the further terms that the angles
    separate.
    """

    of: TumbleUnit
    per_c: Mapping[str, Array | None]
    extra: tuple[str, ...]
    per_c_u: Mapping[str, float]

    def findings(self, index: int) -> Iterator[Finding]:
        """Findings of all coefficients at the dwell of an index, the scale factor also per m/s²."""
        dwell = self.of.dwells[index]
        at = {
            "cycle": dwell.cycle,
            "dwell": dwell.number,
            "leg": "up" if dwell.rising else "down",
            "temperature_set_c": None if math.isnan(dwell.set_c) else dwell.set_c,
            "temperature_c": dwell.temperature_c,
            "temperature_u_c": self.of.temperature_u_c(dwell.temperature_c),
        }
        for quantity in ("K0", "K1", "K2", dwell.tumble.first, *dwell.tumble.extra):
            gain = dwell.gain_of(quantity)
            weights = np.abs(gain) / np.max(np.abs(gain))
            steps = tuple(s for s, weight in zip(dwell.steps, weights, strict=True) if weight > WEIGHT_SHOWN)
            finding = self.of.subject.finding(
                quantity, self._name(quantity), dwell.values[quantity], self.of.units[quantity],
                self._budget(quantity, gain, index), at, steps, _tail(dwell), self._contains(quantity),
            )  # fmt: skip
            yield finding
            if quantity == "K1":
                yield self._per_mps2(finding, dwell)

    def _contains(self, quantity: str) -> tuple[str, ...]:
        """Confounded terms of a value that these angles do not separate."""
        return tuple(f"contains:{name}" for name in CONTAINS.get(quantity, ()) if name not in self.extra)

    def _name(self, quantity: str) -> str:
        if quantity == "K2" and "asymmetry" in self.extra:
            return "second-order nonlinearity"
        return NAMES[quantity]

    def _per_mps2(self, k1: Finding, dwell: Dwell) -> Finding:
        g = self.of.bench.gravity_mps2
        lines = [
            BudgetLine("K1", "B", k1.u / g, k1.dof, k1.id),
            self.of.bench.gravity(k1.value / g),
        ]
        return self.of.subject.finding(
            "K1_si", NAMES["K1_si"], k1.value / g, self.of.units["K1_si"], lines, k1.at, (dwell.group,), _tail(dwell),
            self._contains("K1_si"),
        )  # fmt: skip

    def _budget(self, quantity: str, gain: Array, index: int) -> list[BudgetLine]:
        """Lines of each source by its derivative; the head's errors turn the input axis at every reading."""
        bench, dwell = self.of.bench, self.of.dwells[index]
        turned = gain * dwell.turn
        together = float(turned.sum())  # one rotation common to all positions
        harmonics = by_harmonics(turned, dwell.head_rad, bench.head.harmonics_u_deg)
        lines = [
            *self.of.own(quantity, [(dwell, 1.0)]),
            common("head: zero", together * np.radians(bench.head.zero_u_deg)),
            common("head: harmonics", float(np.linalg.norm(harmonics))),
            bench.level.times(together),
            *self._of_the_instrument(gain, dwell),
        ]
        if quantity in self.per_c:
            read = bench.temperature(self.of.unit.temperature, dwell.temperature_c)
            lines.append(read.times(self._per_c(quantity, index)))
        if quantity == "K2" and "asymmetry" not in self.extra:
            instrument = "converter" if self.of.unit.voltmeter is None else "voltmeter"
            contained = f"asymmetry of the {instrument}: contained, inseparable at these angles"
            lines.append(BudgetLine(contained, "alias", 0))
        return lines

    def _per_c(self, quantity: str, index: int) -> float:
        """Change of a coefficient with 1 °C; its standard uncertainty without a model."""
        per_c = self.per_c[quantity]
        if per_c is not None:
            return float(per_c[index])
        return self.per_c_u[quantity] * (abs(self.of.dwells[index].values["K1"]) if quantity == "K1" else 1.0)

    def _of_the_instrument(self, gain: Array, dwell: Dwell) -> list[BudgetLine]:
        """Lines from the certificate of the counter or voltmeter; an error of the gain is proportional to the output.

        A unit that sends its output is its own instrument; only the quantisation of its codes remains.
        """
        unit = self.of.unit
        if unit.telemetry is not None:
            hidden = np.linalg.norm(quantisation_by_angle(gain, dwell.quantisation_u, dwell.head_rad))
            return [BudgetLine(f"{unit.telemetry}{STEPS}", "B", float(hidden))]
        return instrument_lines(unit, self.of.bench, float(gain @ dwell.readings), float(gain.sum()))


def _tail(dwell: Dwell) -> str:
    """Last part of an id at a dwell."""
    return f"@{dwell.path}" if dwell.path else ""
